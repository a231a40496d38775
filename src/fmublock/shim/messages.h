/* Messages to the host, and checks of what it passes. An Instance has name, logger, environment and logged. */

#define MESSAGE_LENGTH 512

/* For functions that few steps call: compilers keep them apart from the code of all steps. */
#ifdef __GNUC__
#define RARE __attribute__((cold, noinline))
#else
#define RARE
#endif

enum { LOG_EVENTS, LOG_WARNING, LOG_DISCARD, LOG_ERROR, LOG_FATAL, LOG_ALL, N_CATEGORIES };

static const char *const categories[N_CATEGORIES] = {
    "logEvents", "logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal", "logAll"};

#define CATEGORY(category) (1u << (category))
#define EVERYTHING (CATEGORY(N_CATEGORIES) - 1u)
#define PROBLEMS (CATEGORY(LOG_WARNING) | CATEGORY(LOG_DISCARD) | CATEGORY(LOG_ERROR) | CATEGORY(LOG_FATAL))

static int category_of(Status status) {
    switch (status) {
        case StatusOK: return LOG_EVENTS;
        case StatusWarning: return LOG_WARNING;
        case StatusDiscard: return LOG_DISCARD;
        case StatusError: return LOG_ERROR;
        default: return LOG_FATAL;
    }
}

static int is_logged(const Instance *instance, Status status) {
    return instance->logger != NULL && (instance->logged & CATEGORY(category_of(status)));
}

static void deliver(const Instance *instance, Status status, char *message) {
    for (char *c = message; *c; c++)
        if (*c == '%') *c = '#'; /* hosts take the message as a printf format */
    LOG(instance, status, categories[category_of(status)], message);
}

/* Log a message, if its category is on; returns the status. */
RARE static Status report(const Instance *instance, Status status, const char *format, ...) {
    char text[MESSAGE_LENGTH], message[2 * MESSAGE_LENGTH];
    va_list arguments;
    if (!is_logged(instance, status)) return status;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    /* a name that is too long is omitted completely, so that no UTF-8 character is cut */
    const int fits = strlen(instance->name) < MESSAGE_LENGTH;
    snprintf(message, sizeof message, "%s: %s", fits ? instance->name : MODEL_IDENTIFIER, text);
    deliver(instance, status, message);
    return status;
}

static Status check_arrays(const Instance *instance, size_t n, const void *a, const void *b) {
    if (n == 0 || (a != NULL && b != NULL)) return StatusOK;
    return report(instance, StatusError, "%u values were announced, but the array is NULL.", (unsigned)n);
}

/* Check the pointer to which a call writes its result. */
static Status check_place(const Instance *instance, const void *place, const char *what) {
    if (place != NULL) return StatusOK;
    return report(instance, StatusError, "the pointer to %s is NULL.", what);
}

static Status check_experiment(const Instance *instance, Boolean toleranceDefined, double tolerance,
                                   double startTime, Boolean stopTimeDefined, double stopTime) {
    if (!isfinite(startTime))
        return report(instance, StatusError, "the start time %g is not a finite number of seconds.", startTime);
    if (stopTimeDefined && !(stopTime >= startTime))
        return report(instance, StatusError, "the stop time %g s is not after the start time %g s.", stopTime,
                      startTime);
    if (toleranceDefined && !(tolerance > 0.0 && isfinite(tolerance)))
        return report(instance, StatusError, "the tolerance %g is not a positive number.", tolerance);
    return StatusOK;
}
