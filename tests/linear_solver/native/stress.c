/* The linear solver under sanitizers: random matrices, arrays of exactly the length that is asked for, numbers that are
 * not finite, several threads. Prints what it did; returns 1 when a residual is large. */
#include <limits.h>
#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void ma27id_(int *, double *);
void ma27ad_(const int *, const int *, const int *, const int *, int *, const int *, int *, int *, int *, const int *,
             const int *, const double *, int *, double *);
void ma27bd_(const int *, const int *, const int *, const int *, double *, const int *, int *, const int *, int *,
             const int *, int *, int *, const int *, const double *, int *);
void ma27cd_(const int *, const double *, const int *, int *, const int *, double *, const int *, double *, int *,
             const int *, const int *, const double *);
void mc19ad_(const int *, const int *, const double *, const int *, const int *, float *, float *, float *);

static uint64_t next(uint64_t *state)
{
    *state ^= *state << 13, *state ^= *state >> 7, *state ^= *state << 17;
    return *state;
}
static int below(uint64_t *state, int n) { return (int)(next(state) % (uint64_t)n); }
static double uniform(uint64_t *state) { return (double)(next(state) >> 11) / 9007199254740992.0 * 2.0 - 1.0; }

static int factored, singular, wrong;
static pthread_mutex_t counting = PTHREAD_MUTEX_INITIALIZER;

/* One matrix, factored with several values; returns by counting. */
static void try_matrix(uint64_t *state)
{
    const int n = 1 + below(state, 60), m = below(state, n), rows = n + m;
    const int nz = n + 3 * rows;
    int *i = malloc(sizeof(int) * (size_t)nz), *j = malloc(sizeof(int) * (size_t)nz);
    int *keep = malloc(sizeof(int) * 3 * (size_t)rows), *spare = malloc(sizeof(int) * 2 * (size_t)rows);
    double *value = malloc(sizeof(double) * (size_t)nz), *b = malloc(sizeof(double) * (size_t)rows);
    double *x = malloc(sizeof(double) * (size_t)rows);
    int icntl[30], info[20], steps, flag = 0, front = 0, one = 1, nothing[1];
    double cntl[5], operations;
    for (int k = 0; k < n; k++) i[k] = j[k] = k + 1;
    for (int k = n; k < nz; k++) {
        i[k] = 1 + below(state, rows);
        j[k] = 1 + (i[k] > n ? below(state, n) : below(state, rows));
    }
    ma27id_(icntl, cntl);
    icntl[29] = 0; /* singular matrices are told as such */
    cntl[0] = 1e-8;
    ma27ad_(&rows, &nz, i, j, nothing, &one, keep, spare, &steps, &flag, icntl, cntl, info, &operations);
    int la = nz, liw = 1; /* as short as can be, so that every length is asked for */
    double *a = malloc(sizeof(double) * (size_t)la);
    int *iw = malloc(sizeof(int) * (size_t)liw);
    for (int round = 0; round < 4; round++) {
        for (int k = 0; k < nz; k++) value[k] = below(state, 4) ? uniform(state) * pow(10, 3 * uniform(state)) : 0.0;
        if (round == 2) value[below(state, nz)] = below(state, 2) ? NAN : INFINITY;
        for (;;) {
            memcpy(a, value, sizeof(double) * (size_t)nz);
            ma27bd_(&rows, &nz, i, j, a, &la, iw, &liw, keep, &steps, &front, spare, icntl, cntl, info);
            if (info[0] != -3 && info[0] != -4) break;
            if (info[0] == -3) liw = info[1];
            else la = info[1];
            free(a), free(iw);
            a = malloc(sizeof(double) * (size_t)la);
            iw = malloc(sizeof(int) * (size_t)liw);
        }
        pthread_mutex_lock(&counting);
        if (info[0] == 0) factored++;
        else singular++;
        if (round == 2 && info[0] == 0) wrong++;
        pthread_mutex_unlock(&counting);
        if (info[0] != 0) continue;
        double *work = malloc(sizeof(double) * (size_t)front), worst = 0.0, size = 1.0;
        for (int k = 0; k < rows; k++) x[k] = b[k] = uniform(state);
        for (int pass = 0; pass < 3; pass++) { /* with refinement: b - A x is solved for and added */
            double *r = malloc(sizeof(double) * (size_t)rows);
            memcpy(r, b, sizeof(double) * (size_t)rows);
            for (int k = 0; pass > 0 && k < nz; k++) {
                r[i[k] - 1] -= value[k] * x[j[k] - 1];
                if (i[k] != j[k]) r[j[k] - 1] -= value[k] * x[i[k] - 1];
            }
            worst = 0.0;
            for (int k = 0; k < rows; k++) worst = fmax(worst, fabs(r[k]));
            ma27cd_(&rows, a, &la, iw, &liw, work, &front, r, spare, &steps, icntl, cntl);
            for (int k = 0; k < rows; k++) x[k] = pass > 0 ? x[k] + r[k] : r[k];
            free(r);
        }
        for (int k = 0; k < rows; k++) size = fmax(size, fabs(x[k]));
        if (!(worst <= 1e-7 * size * 1e3)) {
            pthread_mutex_lock(&counting);
            wrong++;
            pthread_mutex_unlock(&counting);
        }
        free(work);
    }
    float *r = malloc(sizeof(float) * (size_t)rows), *c = malloc(sizeof(float) * (size_t)rows);
    float *w = malloc(sizeof(float) * 5 * (size_t)rows);
    i[below(state, nz)] = INT_MIN, j[below(state, nz)] = INT_MAX; /* entries beside the matrix are ignored */
    mc19ad_(&rows, &nz, value, i, j, r, c, w);
    free(r), free(c), free(w);
    free(i), free(j), free(keep), free(spare), free(value), free(b), free(x), free(a), free(iw);
}

static void *work(void *seed)
{
    uint64_t state = *(uint64_t *)seed;
    for (int k = 0; k < 200; k++) try_matrix(&state);
    return NULL;
}

int main(void)
{
    pthread_t threads[4];
    uint64_t seeds[4] = {88172645463325252u, 362436069u, 521288629u, 2463534242u};
    for (int k = 0; k < 4; k++) pthread_create(&threads[k], NULL, work, &seeds[k]);
    for (int k = 0; k < 4; k++) pthread_join(threads[k], NULL);
    printf("%d factored, %d refused, %d wrong\n", factored, singular, wrong);
    return wrong > 0;
}
