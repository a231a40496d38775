/* Passes over recorded rows. Exported FMUs do not have this file. */
#include <stdint.h>

#ifndef STEPPER_API
#define STEPPER_API
#endif

STEPPER_API void rows_reduce(const double *rows, int64_t count, int64_t width, double *lowest, double *highest,
                             double *squares);

/* Update smallest and largest value and the sum of squares of each column. NaN changes no smallest or largest. */
void rows_reduce(const double *restrict rows, int64_t count, int64_t width, double *restrict lowest,
                 double *restrict highest, double *restrict squares) {
    int64_t r = 0;
    for (; r + 4 <= count; r += 4) { /* four rows at a time: the results are read and written less often */
        const double *v0 = rows + r * width, *v1 = v0 + width, *v2 = v1 + width, *v3 = v2 + width;
        for (int64_t c = 0; c < width; c++) {
            double least = lowest[c], most = highest[c];
            least = v0[c] < least ? v0[c] : least;
            most = v0[c] > most ? v0[c] : most;
            least = v1[c] < least ? v1[c] : least;
            most = v1[c] > most ? v1[c] : most;
            least = v2[c] < least ? v2[c] : least;
            most = v2[c] > most ? v2[c] : most;
            least = v3[c] < least ? v3[c] : least;
            most = v3[c] > most ? v3[c] : most;
            lowest[c] = least;
            highest[c] = most;
            squares[c] += (v0[c] * v0[c] + v1[c] * v1[c]) + (v2[c] * v2[c] + v3[c] * v3[c]);
        }
    }
    for (; r < count; r++)
        for (int64_t c = 0; c < width; c++) {
            const double v = rows[r * width + c];
            lowest[c] = v < lowest[c] ? v : lowest[c];
            highest[c] = v > highest[c] ? v : highest[c];
            squares[c] += v * v;
        }
}
