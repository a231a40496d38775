/* The categories that the host switches on. */

/* The category's bit; all of them for logAll, 0 for an unknown category. */
static unsigned category_bits(fmi2String name) {
    for (int i = 0; i < N_CATEGORIES && name != NULL; i++)
        if (strcmp(name, categories[i]) == 0) return i == LOG_ALL ? EVERYTHING : CATEGORY(i);
    return 0;
}

/* On: log only these categories, or all if none are named. Off: stop logging these, or all. */
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String names[]) {
    Instance *instance = c;
    unsigned named = nCategories == 0 ? EVERYTHING : 0;
    if (check_arrays(instance, nCategories, names, names) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nCategories; i++) {
        const unsigned bits = category_bits(names[i]);
        if (bits == 0)
            return report(instance, fmi2Error, "there is no log category %.100s.",
                          names[i] == NULL ? "(none)" : names[i]);
        named |= bits;
    }
    instance->logged = loggingOn ? named : instance->logged & ~named;
    return fmi2OK;
}
