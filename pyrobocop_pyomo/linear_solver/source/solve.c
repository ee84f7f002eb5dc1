/* Forward and backward substitution with the factor that factor.c leaves. */
#include "symmetric_solver.h"

static int row_of(int recorded) { return recorded < 0 ? ~recorded : recorded; }

/* L y = x and D z = y in one pass: the pivots of a front are final once the front is through. */
static void forward(int size, int pivots, const int *rows, const double *columns, double *x, double *restrict work)
{
    for (int i = 0; i < size; i++) work[i] = x[row_of(rows[i])];
    for (int k = 0; k < pivots; k++) {
        const double *restrict c = columns + (size_t)k * (size_t)size;
        const double a = work[k];
        if (rows[k] >= 0) {
            for (int i = k + 1; i < size; i++) work[i] -= c[i] * a;
            work[k] = c[k] * a;
            continue;
        }
        const double *restrict d = c + size;
        const double b = work[k + 1];
        for (int i = k + 2; i < size; i++) work[i] -= c[i] * a + d[i] * b;
        work[k] = c[k] * a + c[k + 1] * b;
        work[k + 1] = c[k + 1] * a + d[k + 1] * b;
        k++;
    }
    for (int i = 0; i < size; i++) x[row_of(rows[i])] = work[i];
}

/* L' x = z. */
static void backward(int size, int pivots, const int *rows, const double *columns, double *x, double *restrict work)
{
    for (int i = 0; i < size; i++) work[i] = x[row_of(rows[i])];
    for (int k = pivots - 1; k >= 0; k--) {
        const double *restrict d = columns + (size_t)k * (size_t)size;
        double b = work[k];
        if (k == 0 || rows[k - 1] >= 0) {
            for (int i = k + 1; i < size; i++) b -= d[i] * work[i];
            work[k] = b;
            continue;
        }
        const double *restrict c = d - size;
        double a = work[k - 1];
        for (int i = k + 1; i < size; i++) {
            a -= c[i] * work[i];
            b -= d[i] * work[i];
        }
        work[k] = b;
        work[--k] = a;
    }
    for (int i = 0; i < pivots; i++) x[row_of(rows[i])] = work[i];
}

void solve(int fronts, const int *records, const double *reals, double *x, double *work)
{
    const int *record = records;
    for (int f = 0; f < fronts; f++) {
        forward(record[0], record[1], record + 3, reals + record[2], x, work);
        record += record[0] + 4;
    }
    for (int f = 0; f < fronts; f++) {
        record -= record[-1] + 4;
        backward(record[0], record[1], record + 3, reals + record[2], x, work);
    }
}
