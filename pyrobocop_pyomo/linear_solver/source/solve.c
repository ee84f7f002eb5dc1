/* Forward and backward substitution with the factor that factor.c leaves. */
#include "symmetric_solver.h"

static int row_of(int recorded) { return recorded < 0 ? ~recorded : recorded; }

/* The rows of a front out of x, and zeros behind them up to a whole step. */
static void collect(int size, int stride, const int *rows, const double *x, double *work)
{
    for (int i = 0; i < size; i++) work[i] = x[row_of(rows[i])];
    for (int i = size; i < stride; i++) work[i] = 0.0;
}

/* L y = x and D z = y in one pass: the pivots of a front are final once the front is through. Columns are used in whole
 * steps; what is above their diagonal there is zero. */
static void forward(int size, int pivots, const int *rows, const double *columns, double *x, double *restrict work)
{
    const int stride = stride_of(size);
    collect(size, stride, rows, x, work);
    for (int k = 0; k < pivots; k++) {
        const double *restrict c = columns + (size_t)k * (size_t)stride;
        const double a = work[k];
        const int from = k & ~(STEP - 1);
        const int block = rows[k] < 0;
        if (k + 1 == pivots || (!block && rows[k + 1] < 0)) { /* alone: it is the last, or the next begins a block */
            for (int r = from; r < stride; r += STEP)
                for (int i = r; i < r + STEP; i++) work[i] -= c[i] * a;
            work[k] = c[k] * a;
            continue;
        }
        const double *restrict d = c + stride;
        const double b = block ? work[k + 1] : work[k + 1] - c[k + 1] * a;
        for (int r = from; r < stride; r += STEP)
            for (int i = r; i < r + STEP; i++) work[i] -= c[i] * a + d[i] * b;
        work[k] = block ? c[k] * a + c[k + 1] * b : c[k] * a;
        work[k + 1] = block ? c[k + 1] * a + d[k + 1] * b : d[k + 1] * b;
        k++;
    }
    for (int i = 0; i < size; i++) x[row_of(rows[i])] = work[i];
}

/* L' x = z. */
static void backward(int size, int pivots, const int *rows, const double *columns, double *x, double *restrict work)
{
    const int stride = stride_of(size);
    collect(size, stride, rows, x, work);
    for (int k = pivots - 1; k >= 0; k--) {
        const double *restrict d = columns + (size_t)k * (size_t)stride;
        double b[STEP] = {0.0}, a[STEP] = {0.0};
        const double z = work[k];
        work[k] = 0.0;
        if (k == 0 || (k > 1 && rows[k - 2] < 0)) { /* alone: there is none before, or it belongs to a block */
            for (int r = k & ~(STEP - 1); r < stride; r += STEP)
                for (int q = 0; q < STEP; q++) b[q] += d[r + q] * work[r + q];
            work[k] = z - ((b[0] + b[1]) + (b[2] + b[3]));
            continue;
        }
        /* the column before as well, so that each row is read once for two */
        const double *restrict c = d - stride;
        const double y = work[k - 1];
        work[k - 1] = 0.0;
        for (int r = (k - 1) & ~(STEP - 1); r < stride; r += STEP)
            for (int q = 0; q < STEP; q++) {
                a[q] += c[r + q] * work[r + q];
                b[q] += d[r + q] * work[r + q];
            }
        work[k] = z - ((b[0] + b[1]) + (b[2] + b[3]));
        work[k - 1] = y - ((a[0] + a[1]) + (a[2] + a[3]));
        if (rows[k - 1] >= 0) work[k - 1] -= c[k] * work[k];
        k--;
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
