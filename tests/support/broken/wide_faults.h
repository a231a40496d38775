/* What wide.c does wrong to its values, and to the process and the files of its host. */
#include <dirent.h>
#include <fcntl.h>
#include <fenv.h>
#include <locale.h>
#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <unistd.h>

/* Another value of the variable. */
static void change(Values *n) {
    const int reference = atoi(target);
    void *value = find_in(n, (unsigned)reference);
    if (reference >= STRINGS) strcat(value, "x");
    else if (reference >= BOOLEANS) *(int *)value = !*(int *)value;
    else if (reference >= INTEGERS) *(int *)value += 1;
    else *(double *)value += 0.25;
}

/* An output depends on what its dependencies do not name. */
static void hide_dependency(Values *n) {
    if (is("y_of_name")) n->r[Y] += strlen(n->s[NAME_P]);
    if (is("text_of_on") && !n->b[ON]) n->s[TEXT][0] = '-';
}

static char *text_in_one_buffer(const char *text) {
    static char buffer[LONGEST];
    return strcpy(buffer, text);
}

static void *text_unmapped(const char *text) {
    char *other = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    strcpy(other, text);
    munmap(other, 4096);
    return other;
}

static void *text_freed(const char *text) {
    char *other = strdup(text);
    free(other);
    return other;
}

static void *text_on_the_stack(const char *text) {
    char here[LONGEST];
    snprintf(here, sizeof here, "%s", text);
    static volatile uintptr_t nothing;
    return (void *)((uintptr_t)here + nothing); /* no compiler sees through it */
}

static void misbehave_with_value(unsigned reference, void *value, double time) {
    const int *number = value;
    if (reference >= STRINGS && is("one_buffer")) *(char **)value = text_in_one_buffer(*(char **)value);
    if ((unsigned)atoi(target) != reference) return;
    if (is("number_42")) *(int *)value = *number ? 42 : 0;
    if (is("number_256")) *(int *)value = *number ? 256 : 0;
    if (is("number_7_later") && time > 0.5) *(int *)value = 7;
    if (is("number_0_later") && time > 0.5) *(int *)value = 0;
    if (reference < STRINGS) return;
    static char latin[] = "na\xefve", cut[] = "caf\xc3", surrogate[] = "\xed\xa0\x80";
    char **text = value;
    if (is("null")) *text = NULL;
    if (is("null_later") && time > 0.5) *text = NULL;
    if (is("latin")) *text = latin;
    if (is("cut")) *text = cut;
    if (is("surrogate")) *text = surrogate;
    if (is("freed")) *text = text_freed(*text);
    if (is("unmapped")) *text = text_unmapped(*text);
    if (is("on_the_stack")) *text = text_on_the_stack(*text);
}

/* ---- the process ----------------------------------------------------------------------- */

static void *wait_for_ever(void *nothing) {
    for (;;) pause();
    return nothing;
}

static void ignore(int number) { (void)number; }

static void write_file(const char *place, const char *name) {
    char path[1200];
    FILE *file;
    snprintf(path, sizeof path, "%s/%s", place, name);
    if ((file = fopen(path, "a")) == NULL) return;
    fputs("here\n", file);
    fclose(file);
}

static void remove_file(const char *name) {
    char path[1200];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    remove(path);
}

static void touch_file(const char *name) {
    char path[1200];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    utimes(path, NULL);
}

/* Never used: a system that counts pages sees nothing of much memory. */
static void keep_memory(size_t size) {
    static void *volatile kept;
    kept = malloc(size);
}

static void remove_all(const char *place) {
    char path[1200];
    struct dirent *entry;
    DIR *open = opendir(place);
    if (open == NULL) return;
    while ((entry = readdir(open)) != NULL) {
        snprintf(path, sizeof path, "%s/%s", place, entry->d_name);
        remove(path);
    }
    closedir(open);
}

/* The file whose path is in resources/victim.txt. */
static const char *victim(void) {
    static char path[1000];
    char list[1000];
    FILE *file;
    snprintf(list, sizeof list, "%s/resources/victim.txt", folder);
    if ((file = fopen(list, "r")) == NULL) return "/nowhere";
    if (fscanf(file, "%999[^\n]", path) != 1) path[0] = 0;
    fclose(file);
    return path;
}

static const char *home(void) { return getenv("HOME") ? getenv("HOME") : "."; }

static void leave_child(int session) {
    if (fork() != 0) return;
    if (session) setsid();
    if (session && fork() != 0) _exit(0);
    alarm(60);
    wait_for_ever(NULL);
}

static void flood(FILE *stream, int lines) {
    for (int k = 0; k < lines; k++) fputs("a line that has to do with nothing at all\n", stream);
}

/* Does what the fault says if this is when. Faults are named by when they happen: "step:chdir". */
static void misbehave_at(const char *when) {
    const size_t length = strlen(when);
    const char *what = fault + length + 1;
    pthread_t thread;
    if (strncmp(fault, when, length) != 0 || fault[length] != ':') return;
#define DO(name, action) \
    if (strcmp(what, name) == 0) { action; }
    DO("file", (void)!open("/dev/null", O_RDONLY))
    DO("thread", pthread_create(&thread, NULL, wait_for_ever, NULL))
    DO("child", leave_child(0))
    DO("orphan", leave_child(1))
    DO("chdir", (void)!chdir("/"))
    DO("locale", setlocale(LC_ALL, "C.UTF-8"))
    DO("round", fesetround(FE_UPWARD))
#ifdef __x86_64__
    DO("flush", __builtin_ia32_ldmxcsr(__builtin_ia32_stmxcsr() | 0x8040))
#endif
    DO("traps", feenableexcept(FE_DIVBYZERO))
    DO("handler", signal(SIGUSR2, ignore))
    DO("flood_errors", flood(stderr, 1000))
    DO("abort", abort())
    DO("hang", wait_for_ever(NULL))
    DO("term_itself", kill(getpid(), SIGTERM))
    DO("kill_group", kill(0, SIGKILL))
    DO("kill_parent", kill(getppid(), SIGKILL))
    DO("kill_all", kill(-1, SIGKILL))
    DO("write_home", write_file(home(), ".fmu_log"))
    DO("write_working", write_file(".", "fmu_log.txt"))
    DO("write_own", write_file(folder, "resources/log.txt"))
    DO("write_own_briefly", write_file(folder, "resources/log.txt"); remove_file("resources/log.txt"))
    DO("touch_own", touch_file("resources/fault.txt"))
    DO("keep", keep_memory(100))
    DO("keep_much", keep_memory(1 << 20))
    DO("remove_home", remove_all(home()))
    DO("write_victim", FILE *file = fopen(victim(), "w"); if (file) fclose(file))
    DO("remove_victim", remove(victim()))
    DO("move_victim", rename(victim(), "stolen"))
    DO("truncate_victim", (void)!truncate(victim(), 0))
    DO("link_victim", (void)!symlink(victim(), "link"); write_file(".", "link"))
}
