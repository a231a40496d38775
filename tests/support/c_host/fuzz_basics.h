/* What hosts for random tests stand on: violations with the seed to repeat, random numbers, and memory.
 *
 * HOST is the name of the program.
 */
#ifndef FUZZ_BASICS_H
#define FUZZ_BASICS_H

/* ---- violations ------------------------------------------------------------------------ */

static uint64_t present_seed;

/* AddressSanitizer calls back before it ends the process; UndefinedBehaviorSanitizer has to abort. */
extern void __sanitizer_set_death_callback(void (*callback)(void)) __attribute__((weak));
const char *__ubsan_default_options(void);
const char *__ubsan_default_options(void) { return "abort_on_error=1"; }

static void print_seed(void) {
    fprintf(stderr, HOST ": repeat this with: " HOST " %llu 1\n", (unsigned long long)present_seed);
}

static void take_signal(int number) {
    print_seed();
    _Exit(128 + number);
}

static void watch_for_death(void) {
    const struct sigaction action = {.sa_handler = take_signal};
    sigaction(SIGABRT, &action, NULL);
    if (__sanitizer_set_death_callback != NULL) __sanitizer_set_death_callback(print_seed);
}

static void violate(const char *file, int line, const char *message) {
    fprintf(stderr, HOST ": %s, line %d: %s\n", file, line, message);
    print_seed();
    _Exit(1); /* what lives is not a leak */
}

#define REQUIRE(condition, message)                             \
    do {                                                        \
        if (!(condition)) violate(__FILE__, __LINE__, message); \
    } while (0)

/* ---- random numbers -------------------------------------------------------------------- */

typedef struct {
    uint64_t state;
} Dice;

/* SplitMix64: any seed will do, also those that differ by 1. */
static uint64_t roll(Dice *dice) {
    uint64_t z = dice->state += 0x9E3779B97F4A7C15u;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

static int32_t below(Dice *dice, int32_t n) { return (int32_t)(roll(dice) % (uint64_t)n); }

static int32_t between(Dice *dice, int32_t low, int32_t high) { return low + below(dice, high - low + 1); }

static double uniform(Dice *dice, double low, double high) {
    return low + (high - low) * (double)(roll(dice) >> 11) / 9007199254740992.0;
}

static int happens(Dice *dice, double probability) { return uniform(dice, 0.0, 1.0) < probability; }

/* ---- memory ---------------------------------------------------------------------------- */

/* Memory of exactly this size. Doubles in it are NaN, so that results show if it is read before it is written. */
static void *allocate(size_t count, size_t size) {
    void *memory = malloc(count * size);
    if (memory == NULL) abort();
    if (count > 0) memset(memory, 0xFF, count * size);
    return memory;
}

#endif
