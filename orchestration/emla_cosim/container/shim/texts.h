/* Connections of Strings and Binary values: they are passed on before each step. */

#if N_TEXT_LINKS > 0

/* A text or bytes, in the memory of its part. */
typedef struct {
    const unsigned char *bytes;
    size_t size;
} Content;

#ifdef HAS_FMI3_PARTS
static int32_t get_bytes(Instance *instance, int part, fmi2ValueReference reference, Content *content) {
    const Function get = instance->functions[parts[part].library][FMI3_GetBinary];
    return (int32_t)((fmi3GetBinaryTYPE *)get)(instance->parts[part], &reference, 1, &content->size, &content->bytes, 1);
}

static int32_t set_bytes(Instance *instance, const TextLink *link, const Content *content) {
    const Function set = instance->functions[parts[link->target].library][FMI3_SetBinary];
    int32_t status = begin_change(instance, link->target, link->way);
    if (!is_bad(status))
        status = (int32_t)((fmi3SetBinaryTYPE *)set)(instance->parts[link->target], &link->input, 1, &content->size,
                                                     &content->bytes, 1);
    return is_bad(status) ? status : end_change(instance, link->target, link->way);
}
#endif

static Status get_content(Instance *instance, const TextLink *link, int part, fmi2ValueReference reference,
                          Content *content) {
    const char *text = NULL;
    *content = (Content){NULL, 0};
#ifdef HAS_FMI3_PARTS
    const int32_t status = link->is_binary ? get_bytes(instance, part, reference, content)
                                           : get_text(instance, part, reference, &text);
#else
    const int32_t status = get_text(instance, part, reference, &text);
#endif
    if (is_bad(status)) return blame_part(instance, part, "the reading of a text", status);
    if (!link->is_binary) *content = (Content){(const unsigned char *)text, text == NULL ? 0 : strlen(text)};
    return StatusOK;
}

static Status set_content(Instance *instance, const TextLink *link, const Content *content) {
    const char *text = content->bytes == NULL ? "" : (const char *)content->bytes;
    if (link->most_bytes > 0 && content->size > link->most_bytes) {
        instance->memory.phase = FAILED;
        return report(instance, StatusError, "%s has %u bytes, but %s takes %u at the most.", link->source_name,
                      (unsigned)content->size, link->target_name, (unsigned)link->most_bytes);
    }
#ifdef HAS_FMI3_PARTS
    const int32_t status = link->is_binary ? set_bytes(instance, link, content)
                                           : set_text(instance, link->target, link->way, link->input, text);
#else
    const int32_t status = set_text(instance, link->target, link->way, link->input, text);
#endif
    return is_bad(status) ? blame_part(instance, link->target, "the setting of a text", status) : StatusOK;
}

/* Copy what a part has, as it may free it in the next call; 0 without memory. */
static int copy_content(Content *content) {
    unsigned char *copy = malloc(content->size + 1);
    if (copy == NULL) return 0;
    if (content->size > 0) memcpy(copy, content->bytes, content->size);
    copy[content->size] = '\0';
    content->bytes = copy;
    return 1;
}

static Status get_copies(Instance *instance, Content *copies) {
    for (int k = 0; k < N_TEXT_LINKS; k++) {
        const TextLink *link = &text_links[k];
        Content content;
        const Status status = get_content(instance, link, link->source, link->output, &content);
        if (status != StatusOK) return status;
        if (!copy_content(&content)) return report(instance, StatusError, "out of memory.");
        copies[k] = content;
    }
    return StatusOK;
}

/* Pass all texts on; `changed` is set if an input got another one. One that has it already is not set, because
   setting may cause an event. All are read before the first one is set, so their order does not matter. */
static Status pass_texts(Instance *instance, int *changed) {
    Content copies[N_TEXT_LINKS] = {{NULL, 0}}, present;
    Status status = get_copies(instance, copies);
    *changed = 0;
    for (int k = 0; k < N_TEXT_LINKS && status == StatusOK; k++) {
        const TextLink *link = &text_links[k];
        status = get_content(instance, link, link->target, link->input, &present);
        if (status != StatusOK) break;
        const int is_same = present.size == copies[k].size &&
                            (present.size == 0 || memcmp(present.bytes, copies[k].bytes, present.size) == 0);
        if (is_same) continue;
        status = set_content(instance, link, &copies[k]);
        *changed = 1;
    }
    for (int k = 0; k < N_TEXT_LINKS; k++) free((void *)copies[k].bytes);
    return status;
}

/* The step of what the stepper takes for an instance that only steps. */
static fmi2Status step_texts(fmi2Component c, fmi2Real time, fmi2Real length, fmi2Boolean no_way_back) {
    int changed = 0;
    (void)time, (void)length, (void)no_way_back;
    return pass_texts(c, &changed) == StatusOK ? fmi2OK : fmi2Error;
}

#else

static Status pass_texts(Instance *instance, int *changed) { return (void)instance, *changed = 0, StatusOK; }

#endif
