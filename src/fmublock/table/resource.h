/* Read the data of an instance from resources/table.bin when it is made. */

#define GUID(state) ((const char *)((state)->resource + AT_GUID))
#define SHOWN(instance) ((ValueReference)(1 + outputs_of((instance)->now.resource)))
#define FIXED(state) ((state)->resource)
#define RESOURCE_END(state) resource_end((state)->resource)

#define MAGIC "EMLATBL2"
#define FILE_NAME "/table.bin"

/* Number of outputs and of the values of their spans. */
static size_t outputs_of(const double *data) {
    const Table t = table_of(data);
    return t.outputs * (t.has_spans ? PER_OUTPUT : 1);
}

static double resource_end(const double *data) {
    const Table t = table_of(data);
    return t.end == STOP ? t.times[t.rows - 1] : HUGE_VAL;
}

/* ---- where the file is ----------------------------------------------------------------- */

static int hexadecimal(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
}

/* Decode %20 and the like. */
static void decode(char *text) {
    char *to = text;
    for (const char *from = text; *from; from++) {
        const int high = *from == '%' ? hexadecimal(from[1]) : -1;
        const int low = high >= 0 ? hexadecimal(from[2]) : -1;
        *to++ = low >= 0 ? (char)(16 * high + low) : *from;
        if (low >= 0) from += 2;
    }
    *to = '\0';
}

/* The path of the file, to be freed; from the folder's URI, or from its path, which some hosts pass. */
static char *file_path(const char *location) {
    const int is_uri = strncmp(location, "file:", 5) == 0;
    const char *begin = is_uri ? location + 5 : location;
    if (is_uri && strncmp(begin, "//", 2) == 0) {
        const char *path = strchr(begin + 2, '/'); /* behind the name of the host */
        if (path != NULL) begin = path;
    }
    char *path = malloc(strlen(begin) + sizeof FILE_NAME);
    if (path == NULL) return NULL;
    strcpy(path, begin);
    if (is_uri) decode(path);
#ifdef _WIN32
    if (is_uri && path[0] == '/' && path[1] != '\0' && path[2] == ':') memmove(path, path + 1, strlen(path));
#endif
    return strcat(path, FILE_NAME);
}

static FILE *open_file(const char *path) {
#ifdef _WIN32
    wchar_t wide[4096];
    if (!MultiByteToWideChar(CP_UTF8, 0, path, -1, wide, 4096)) return NULL;
    return _wfopen(wide, L"rb");
#else
    return fopen(path, "rb");
#endif
}

/* ---- what is in it --------------------------------------------------------------------- */

static uint64_t word_sum(const double *data, uint64_t count) {
    uint64_t sum = 0;
    for (uint64_t i = 0; i < count; i++) {
        uint64_t word;
        memcpy(&word, data + i, sizeof word);
        sum += word * (2 * i + 1);
    }
    return sum;
}

/* The numbers of a file, to be freed; NULL if it is truncated, damaged or of another kind. */
static double *read_numbers(FILE *file, uint64_t *count) {
    char magic[sizeof MAGIC - 1];
    uint64_t sum;
    if (fread(magic, sizeof magic, 1, file) != 1 || memcmp(magic, MAGIC, sizeof magic) != 0) return NULL;
    if (fread(count, sizeof *count, 1, file) != 1 || *count > SIZE_MAX / sizeof(double)) return NULL;
    double *data = malloc((size_t)*count * sizeof(double));
    if (data == NULL) return NULL;
    const int whole = fread(data, sizeof(double), (size_t)*count, file) == *count &&
                      fread(&sum, sizeof sum, 1, file) == 1 && fgetc(file) == EOF;
    if (whole && sum == word_sum(data, *count)) return data;
    free(data);
    return NULL;
}

static int is_whole(double x, double most) { return x >= 0.0 && x <= most && x == floor(x); }

static int sizes_fit(const double *data, uint64_t count) {
    const double most = (double)count;
    if (count < AT_TABLES || ((const char *)data)[GUID_SIZE - 1] != '\0') return 0;
    if (!is_whole(data[AT_ROWS], most) || data[AT_ROWS] < 2.0) return 0;
    if (!is_whole(data[AT_COLUMNS], most) || !is_whole(data[AT_OUTPUTS], N_OUTPUTS)) return 0;
    if (!is_whole(data[AT_END], N_ENDS - 1) || !is_whole(data[AT_SPANS], 1)) return 0;
    if (outputs_of(data) > N_OUTPUTS) return 0;
    const double rows = data[AT_ROWS], columns = data[AT_COLUMNS];
    return AT_TABLES + columns + N_OUTPUT * data[AT_OUTPUTS] + rows * (2.0 + PER_COLUMN * columns) == most;
}

static int numbers_fit(const double *data) {
    const Table t = table_of(data);
    for (size_t i = 0; i < t.columns; i++)
        if (!is_whole(t.kinds[i], N_KINDS - 1)) return 0;
    for (size_t i = 0; i < t.outputs; i++) {
        const double *shown = t.shown + N_OUTPUT * i;
        if (!is_whole(shown[COLUMN], (double)t.columns - 1.0) || !is_whole(shown[ORDER], MAXIMUM_ORDER)) return 0;
    }
    for (size_t i = 0; i < t.rows; i++) {
        if (!isfinite(t.times[i]) || (i > 0 && !(t.times[i] >= t.times[i - 1]))) return 0;
        if (!is_whole(t.index[i], (double)t.rows - 2.0)) return 0;
    }
    return t.times[t.rows - 1] > t.times[0];
}

static Status open_resource(Instance *instance, String location) {
    uint64_t count = 0;
    if (location == NULL) return report(instance, StatusError, "the location of the resources is NULL.");
    char *path = file_path(location);
    if (path == NULL) return report(instance, StatusError, "out of memory.");
    FILE *file = open_file(path);
    double *data = file != NULL ? read_numbers(file, &count) : NULL;
    if (file != NULL) fclose(file);
    if (data != NULL && sizes_fit(data, count) && numbers_fit(data)) {
        free(path);
        instance->now.resource = data;
        return StatusOK;
    }
    report(instance, StatusError, "the data in %.300s %s.", path,
           file == NULL ? "cannot be opened" : "are truncated, damaged or of another kind");
    free(data);
    free(path);
    return StatusError;
}
