/* Libraries of parts that are not compiled in, from the resources of this FMU. */

#if N_LOADED > 0

#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#include <windows.h>
#else
#include <dlfcn.h>
#endif

#ifdef _WIN32
#define SUFFIX ".dll"
#elif defined __APPLE__
#define SUFFIX ".dylib"
#else
#define SUFFIX ".so"
#endif

#if defined __aarch64__ && defined __APPLE__
#define PLATFORM "aarch64-darwin"
#elif defined __aarch64__
#define PLATFORM "aarch64-linux"
#elif defined _WIN32
#define PLATFORM "win64"
#elif defined __APPLE__
#define PLATFORM "darwin64"
#else
#define PLATFORM "linux64"
#endif

static int hexadecimal(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
}

/* Return a new text: the path of a file: URI, or a copy of a text that is none. */
static char *path_of(const char *uri, const char *more) {
    char *path = malloc(strlen(uri) + strlen(more) + 1), *end = path;
    if (path == NULL) return NULL;
    const int is_uri = strncmp(uri, "file:", 5) == 0;
    if (is_uri) {
        uri += 5;
        if (strncmp(uri, "//", 2) == 0) {
            uri += 2;
            if (strncmp(uri, "localhost/", 10) == 0) uri += 9;
        }
#ifdef _WIN32
        if (uri[0] == '/' && uri[1] != '\0' && uri[2] == ':') uri++;
#endif
    }
    for (; *uri; uri++) {
        const int high = is_uri && *uri == '%' ? hexadecimal(uri[1]) : -1;
        const int low = high >= 0 ? hexadecimal(uri[2]) : -1;
        if (low >= 0) {
            *end++ = (char)(16 * high + low);
            uri += 2;
        } else {
            *end++ = *uri;
        }
    }
    strcpy(end, more);
    return path;
}

static void *open_library(const char *path) {
#ifdef _WIN32
    wchar_t wide[2048];
    if (MultiByteToWideChar(CP_UTF8, 0, path, -1, wide, 2048) == 0) return NULL;
    return (void *)LoadLibraryExW(wide, NULL, LOAD_WITH_ALTERED_SEARCH_PATH);
#else
    return dlopen(path, RTLD_NOW | RTLD_LOCAL);
#endif
}

static void close_library(void *handle) {
#ifdef _WIN32
    FreeLibrary((HMODULE)handle);
#else
    dlclose(handle);
#endif
}

static void *find_symbol(void *handle, const char *name) {
#ifdef _WIN32
    return (void *)GetProcAddress((HMODULE)handle, name);
#else
    return dlsym(handle, name);
#endif
}

/* Fill the functions from a library; returns the name of a missing one that is needed, or NULL. */
static const char *load_functions(const Library *library, void *handle, Function *functions) {
    static const FunctionName names_2[] = {FUNCTIONS_2(NAME_2, _)};
#ifdef HAS_FMI3_PARTS
    static const FunctionName names_3[] = {FUNCTIONS_3(NAME_3, _)};
    const FunctionName *names = library->fmi == 3 ? names_3 : names_2;
    const int n = library->fmi == 3 ? N_FUNCTIONS_3 : N_FUNCTIONS_2;
#else
    const FunctionName *names = names_2;
    const int n = N_FUNCTIONS_2;
#endif
    for (int f = 0; f < n; f++) {
        void *found = find_symbol(handle, names[f].name);
        if (found == NULL && names[f].need & library->needs) return names[f].name;
        memcpy(&functions[f], &found, sizeof found);
    }
    return NULL;
}

static Status load_library(Instance *instance, int i) {
    const Library *library = &libraries[i];
    char more[512];
    if (instance->location == NULL)
        return report(instance, StatusError, "the host gave no place of the resources, where %s is.",
                      library->folder);
    snprintf(more, sizeof more, "/%s/binaries/" PLATFORM "/%s" SUFFIX, library->folder, library->file);
    char *path = path_of(instance->location, more);
    if (path == NULL) return report(instance, StatusError, "out of memory.");
    instance->handles[i] = open_library(path);
    if (instance->handles[i] == NULL) report(instance, StatusError, "the library %s cannot be loaded.", path);
    free(path);
    if (instance->handles[i] == NULL) return StatusError;
    const char *missing = load_functions(library, instance->handles[i], instance->functions[i]);
    if (missing == NULL) return StatusOK;
    return report(instance, StatusError, "the library of %s has no function %s.", library->folder, missing);
}

static void close_libraries(Instance *instance) {
    for (int i = 0; i < N_LIBRARIES; i++)
        if (instance->handles[i] != NULL) close_library(instance->handles[i]);
}

#else

static Status load_library(Instance *instance, int i) { return (void)instance, (void)i, StatusOK; }

static void close_libraries(Instance *instance) { (void)instance; }

#endif

/* Make the functions of all libraries callable. */
static Status open_libraries(Instance *instance) {
    for (int i = 0; i < N_LIBRARIES; i++)
        if (libraries[i].functions != NULL)
            memcpy(instance->functions[i], libraries[i].functions, N_FUNCTIONS_2 * sizeof(Function));
        else if (load_library(instance, i) != StatusOK)
            return StatusError;
    return StatusOK;
}
