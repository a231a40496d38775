/* The categories that the host switches on. */

/* The category's bit; all of them for logAll, 0 for an unknown category. */
static unsigned category_bits(String name) {
    for (int i = 0; i < N_CATEGORIES && name != NULL; i++)
        if (strcmp(name, categories[i]) == 0) return i == LOG_ALL ? EVERYTHING : CATEGORY(i);
    return 0;
}

/* On: log only these categories, or all if none are named. Off: stop logging these, or all. */
Status FMI(SetDebugLogging)(Handle c, Boolean loggingOn, size_t nCategories,
                               const String names[]) {
    Instance *instance = c;
    unsigned named = nCategories == 0 ? EVERYTHING : 0;
    if (check_arrays(instance, nCategories, names, names) != StatusOK) return StatusError;
    for (size_t i = 0; i < nCategories; i++) {
        const unsigned bits = category_bits(names[i]);
        if (bits == 0)
            return report(instance, StatusError, "there is no log category %.100s.",
                          names[i] == NULL ? "(none)" : names[i]);
        named |= bits;
    }
    instance->logged = loggingOn ? named : instance->logged & ~named;
    return StatusOK;
}
