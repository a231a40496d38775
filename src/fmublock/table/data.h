/* Data over time as the outputs of an FMU, instead of generated equations.
 *
 * The data are one array of doubles, read from the FMU's resources by resource.h and written by
 * layout.py: a head, the kind of every column, four numbers for every output, the times of the
 * rows, the rows themselves, and an index of them.
 */

enum { AT_GUID = 0, AT_ROWS = 5, AT_COLUMNS, AT_OUTPUTS, AT_END, AT_TABLES }; /* the head */
enum { HELD, LINEAR, CUBIC, N_KINDS };                                        /* of a column */
enum { HOLD, REPEAT, STOP, N_ENDS };                                          /* what follows the last row */
enum { COLUMN, ORDER, GAIN, OFFSET, N_OUTPUT };                               /* of an output */
enum { MAXIMUM_ORDER = 2, PER_COLUMN = 2 }; /* a row has value and slope of every column */

typedef struct {
    size_t rows, columns, outputs;
    int end;
    const double *kinds, *shown, *times, *values, *index;
} Table;

static Table table_of(const double *data) {
    Table t;
    t.rows = (size_t)data[AT_ROWS];
    t.columns = (size_t)data[AT_COLUMNS];
    t.outputs = (size_t)data[AT_OUTPUTS];
    t.end = (int)data[AT_END];
    t.kinds = data + AT_TABLES;
    t.shown = t.kinds + t.columns;
    t.times = t.shown + N_OUTPUT * t.outputs;
    t.values = t.times + t.rows;
    t.index = t.values + PER_COLUMN * t.columns * t.rows;
    return t;
}

/* A row, and how far a time is behind it; the data rest before the first row and after the last. */
typedef struct {
    size_t row;
    double behind;
    int rests;
} Place;

/* The last row that is not after a time between the first and the last one. The index divides the time
 * into as many equal parts as there are rows, so that evenly spaced rows need no search.
 */
static size_t row_at(const Table *t, double time) {
    const double first = t->times[0], last = t->times[t->rows - 1];
    const double part = (time - first) / (last - first) * (double)t->rows;
    const size_t slot = part < (double)(t->rows - 1) ? (size_t)part : t->rows - 1;
    size_t low = (size_t)t->index[slot];
    size_t high = slot + 1 < t->rows ? (size_t)t->index[slot + 1] + 1 : t->rows - 1;
    while (low > 0 && t->times[low] > time) low--;
    while (high < t->rows - 1 && t->times[high] <= time) high++;
    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (t->times[middle] <= time) low = middle;
        else high = middle;
    }
    return low;
}

/* Replace a time that differs from that of a row only by rounding. */
static Place place_of(const Table *t, double time) {
    const double first = t->times[0], last = t->times[t->rows - 1];
    const double rounding = TIME_ROUNDING * fmax(fabs(time), fmax(fabs(first), fabs(last)));
    double seen = time + rounding;
    if (seen < first) return (Place){0, 0.0, 1};
    if (t->end == REPEAT && seen >= last) {
        seen = first + fmod(seen - first, last - first);
        if (seen >= last) seen = first; /* by rounding */
        time = seen - rounding;
    }
    if (seen >= last) return (Place){t->rows - 1, 0.0, 1};
    const size_t row = row_at(t, seen);
    const double behind = time - t->times[row];
    return (Place){row, behind > rounding ? behind : 0.0, 0};
}

/* A column's value, or its time derivative of an order up to 3. */
static double value_of(const Table *t, size_t column, int order, const Place *place) {
    const double *y = t->values + PER_COLUMN * (place->row * t->columns + column);
    const int kind = (int)t->kinds[column];
    if (place->rests || kind == HELD) return order == 0 ? y[0] : 0.0;
    const double *next = y + PER_COLUMN * t->columns;
    const double s = place->behind, h = t->times[place->row + 1] - t->times[place->row];
    const double slope = (next[0] - y[0]) / h;
    if (kind == LINEAR) return order == 0 ? slope * s + y[0] : order == 1 ? slope : 0.0;
    const double second = (3.0 * slope - 2.0 * y[1] - next[1]) / h, third = (y[1] + next[1] - 2.0 * slope) / (h * h);
    switch (order) {
        case 0: return y[0] + s * (y[1] + s * (second + s * third));
        case 1: return y[1] + s * (2.0 * second + 3.0 * s * third);
        case 2: return 2.0 * second + 6.0 * s * third;
        default: return 6.0 * third;
    }
}

/* ---- instead of generated.h ------------------------------------------------------------ */

#define N_FIXED 0
#define N_STEPWISE 0

static void outputs(double time, const double *v, const double *data, double *result) {
    (void)v;
    const Table t = table_of(data);
    const Place place = place_of(&t, time);
    for (size_t i = 0; i < t.outputs; i++) {
        const double *shown = t.shown + N_OUTPUT * i;
        const double value = value_of(&t, (size_t)shown[COLUMN], (int)shown[ORDER], &place);
        result[i] = shown[GAIN] * value + shown[OFFSET];
    }
}

/* Data depend on time only. */
static void outputs_tangent(double time, const double *v, const double *data, double d_time, const double *d,
                            double *result) {
    (void)v, (void)d;
    const Table t = table_of(data);
    const Place place = place_of(&t, time);
    for (size_t i = 0; i < t.outputs; i++) {
        const double *shown = t.shown + N_OUTPUT * i;
        const double rate = value_of(&t, (size_t)shown[COLUMN], (int)shown[ORDER] + 1, &place);
        result[i] = shown[GAIN] * rate * d_time;
    }
}

#define fixed_values(...)
#define stepwise_values(...)
#define derivatives(...)
#define derivatives_tangent(...)
#define update_and_outputs(time, v, data, next, result) ((void)next, outputs(time, v, data, result))
