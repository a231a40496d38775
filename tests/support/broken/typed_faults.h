/* What typed.c does wrong to the process and the files of its host, and with its Strings. */
#include <fcntl.h>
#include <fenv.h>
#include <locale.h>
#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum {
    NONE,
    START_REAL,
    START_INTEGER,
    START_BOOLEAN,
    START_STRING,
    START_STATE,
    OTHER_VERSION, /* at compile time */
    STATE_FORGETS_TUNABLE,
    STATE_FORGETS_BOOLEAN,
    STATE_FORGETS_STRING,
    STATE_FORGETS_INPUT,
    BYTES_FORGET_TUNABLE,
    RESET_KEEPS_PARAMETER,
    RESET_KEEPS_STRING,
    RESET_KEEPS_INPUT,
    SHARED_PARAMETER,
    STRING_NULL,
    STRING_NOT_UTF8,
    STRING_FREED,
    STRING_UNMAPPED,
    STRING_ON_THE_STACK,
    ENUMERATION_OUTSIDE,
    BOOLEAN_42,
    STEP_DOES_NOTHING,
    INPUT_IGNORED,
    INPUT_SIGN,
    INTERPOLATION_IGNORED,
    STATE_POINTER_KEPT,
    FILE_LEFT_OPEN,
    THREAD_LEFT,
    CHILD_LEFT,
    ORPHAN_LEFT,
    UNLOAD_ABORTS,
    SIGNAL_TO_ITSELF,
    SIGNAL_TO_THE_GROUP,
    SIGNAL_TO_THE_PARENT,
    WORKING_FOLDER,
    LOCALE,
    ROUNDING,
    FLUSH_TO_ZERO,
    TRAPS,
    SIGNAL_HANDLER,
    FLOOD_OUTPUT,
    FLOOD_ERRORS,
    OWN_FILE_WRITTEN,
    USER_FILE_WRITTEN,
    HOME_FILE_WRITTEN
};

static int loaded_fault; /* for the end, when there is no instance */

static int read_fault(const char *folder) {
    char path[1024];
    int fault = NONE;
    FILE *file;
    snprintf(path, sizeof path, "%s/fault.txt", folder);
    file = fopen(path, "r");
    if (file == NULL) return NONE;
    if (fscanf(file, "%d", &fault) != 1) fault = NONE;
    fclose(file);
    return loaded_fault = fault;
}

static void *wait_for_ever(void *nothing) {
    for (;;) pause();
    return nothing;
}

static void ignore(int number) { (void)number; }

__attribute__((destructor)) static void unload(void) {
    if (loaded_fault == UNLOAD_ABORTS) abort();
}

static void misbehave_at_instantiation(int fault) {
    pthread_t thread;
    switch (fault) {
        case FILE_LEFT_OPEN: (void)!open("/dev/null", O_RDONLY); break;
        case THREAD_LEFT: pthread_create(&thread, NULL, wait_for_ever, NULL); break;
        case CHILD_LEFT:
            if (fork() == 0) wait_for_ever(NULL);
            break;
        case ORPHAN_LEFT: /* in a session of its own, so that no signal to the group reaches it */
            if (fork() == 0) {
                setsid();
                if (fork() == 0) {
                    alarm(60);
                    wait_for_ever(NULL);
                }
                _exit(0);
            }
            break;
        default: break;
    }
}

static void write_file(const char *folder, const char *name) {
    char path[1024];
    FILE *file;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    file = fopen(path, "a");
    if (file == NULL) return;
    fputs("here\n", file);
    fclose(file);
}

static void misbehave_in_a_step(int fault, const char *resources) {
    switch (fault) {
        case SIGNAL_TO_ITSELF: kill(getpid(), SIGTERM); break;
        case SIGNAL_TO_THE_GROUP: kill(0, SIGKILL); break;
        case SIGNAL_TO_THE_PARENT: kill(getppid(), SIGKILL); break;
        case WORKING_FOLDER: (void)!chdir("/"); break;
        case LOCALE: setlocale(LC_ALL, "C.UTF-8"); break;
        case ROUNDING: fesetround(FE_UPWARD); break;
#ifdef __x86_64__
        case FLUSH_TO_ZERO: __builtin_ia32_ldmxcsr(__builtin_ia32_stmxcsr() | 0x8040); break;
#endif
        case TRAPS: feenableexcept(FE_DIVBYZERO); break;
        case SIGNAL_HANDLER: signal(SIGUSR2, ignore); break;
        case FLOOD_OUTPUT:
        case FLOOD_ERRORS:
            for (int k = 0; k < 1000; k++)
                fputs("a line that has to do with nothing at all\n", fault == FLOOD_OUTPUT ? stdout : stderr);
            break;
        case OWN_FILE_WRITTEN: write_file(resources, "log.txt"); break;
        case USER_FILE_WRITTEN: write_file(".", "fmu_log.txt"); break;
        case HOME_FILE_WRITTEN: write_file(getenv("HOME") ? getenv("HOME") : ".", ".fmu_log"); break;
        default: break;
    }
}

/* What is returned in place of a text. */
static const char *misbehave_with_text(int fault, char *text) {
    static char wrong[] = "na\xefve";
    char here[32];
    char *other;
    switch (fault) {
        case STRING_NULL: return NULL;
        case STRING_NOT_UTF8: return wrong;
        case STRING_FREED:
            other = strdup(text);
            free(other);
            return other;
        case STRING_UNMAPPED:
            other = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
            strcpy(other, text);
            munmap(other, 4096);
            return other;
        case STRING_ON_THE_STACK:
            snprintf(here, sizeof here, "%s", text);
            return (const char *)((uintptr_t)here + loaded_fault - fault); /* no compiler sees through it */
        default: return text;
    }
}
