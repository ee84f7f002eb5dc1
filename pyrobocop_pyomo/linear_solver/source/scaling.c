/* Scaling of a symmetric matrix, behind the calling convention of MC19, which Ipopt asks for when solutions of the linear
 * systems are not good enough (linear_scaling_on_demand).
 *
 * Rows and columns are divided by the root of their largest entry until all largest entries are one: D. Ruiz, A scaling
 * algorithm to equilibrate both rows and columns norms in matrices, Report RAL-TR-2001-034, Rutherford Appleton
 * Laboratory (2001). MC19 itself fits logarithms instead; Ipopt needs nothing but factors.
 */
#include "exported.h"

#include <math.h>

enum { ROUNDS = 8 };

/* R and C receive the natural logarithms of the factors of rows and columns; W has room for 5 n numbers. */
PUBLIC void mc19ad_(const int *n, const int *nz, const double *a, const int *irn, const int *icn, float *r, float *c,
                    float *w)
{
    for (int i = 0; i < *n; i++) r[i] = 0.0f;
    for (int round = 0; round < ROUNDS; round++) {
        for (int i = 0; i < *n; i++) w[i] = -INFINITY;
        for (int k = 0; k < *nz; k++) {
            if (irn[k] < 1 || irn[k] > *n || icn[k] < 1 || icn[k] > *n || a[k] == 0.0) continue;
            const int i = irn[k] - 1, j = icn[k] - 1;
            const float size = (float)log(fabs(a[k])) + r[i] + r[j];
            if (size > w[i]) w[i] = size;
            if (size > w[j]) w[j] = size;
        }
        for (int i = 0; i < *n; i++)
            if (w[i] > -INFINITY && w[i] < INFINITY) r[i] -= 0.5f * w[i];
    }
    for (int i = 0; i < *n; i++) c[i] = r[i];
}
