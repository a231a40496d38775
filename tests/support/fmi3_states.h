/* States of an FMU whose instances are a struct Model, and functions that it has no use for.
 *
 * To be included after Model and EXPORT are defined.
 */

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance i, fmi3FMUState *s)
{
    *s = *s ? *s : malloc(sizeof(Model));
    memcpy(*s, i, sizeof(Model));
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance i, fmi3FMUState s)
{
    memcpy(i, s, sizeof(Model));
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance i, fmi3FMUState *s)
{
    free(*s);
    *s = NULL;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance i, fmi3FMUState s, size_t *n)
{
    *n = sizeof(Model);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance i, fmi3FMUState s, fmi3Byte b[], size_t n)
{
    memcpy(b, s, n);
    return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance i, const fmi3Byte b[], size_t n, fmi3FMUState *s)
{
    *s = malloc(n);
    memcpy(*s, b, n);
    return fmi3OK;
}

/* Functions that a host looks up, and that this FMU has no use for. */
#define ABSENT(name) EXPORT fmi3Status name(void) { return fmi3Error; }
