/* The numbers: one dense front after another.
 *
 * Multifrontal method as in I. S. Duff and J. K. Reid (1983), doi:10.1145/356044.356047. Pivots are accepted as in
 * C. Ashcraft, R. G. Grimes and J. G. Lewis, Accurate symmetric indefinite linear equation solvers, SIAM J. Matrix
 * Anal. Appl. 20 (1998) 513-561, doi:10.1137/S0895479896296921; a column without an acceptable pivot is handed on to
 * the parent of its front.
 */
#include "symmetric_solver.h"

#include <float.h>
#include <limits.h>
#include <math.h>
#include <string.h>

/* Pivots that are eliminated before the rest of a front is updated with all of them at once. */
enum { BLOCK = 48 };
/* A front whose square is no int is too large. */
enum { LARGEST = 46336 };
/* A pivot this good is taken at once; what the caller's threshold allows, only where no pivot of a block is so good. */
static const double GOOD = 0.1;
/* Part of a determinant that cancellation must leave. */
static const double CANCELLED = 1e-10;
/* What is left of a diagonal entry after terms this much larger were taken off is rounding, without a sign to count. */
static const double ROUNDED = 1e-14;

/* Fronts up to this size are updated with each pivot at once; larger ones with all pivots of a block. */
enum { SMALL = 64 };

/* A front in the making: the lower triangle of `size` rows, stored by columns that are `stride` apart. Columns are updated
 * in whole steps of STEP rows: what that leaves above the diagonal is never read, and the rows behind the last are zero. */
typedef struct {
    double *entries;
    int size, stride;
    int assembled;                   /* columns that may be eliminated here */
    double *taken;                   /* sums of the terms that were taken off the diagonal of each row, so far */
    int *rows;                       /* of the matrix; those of a pivot's first row turn to ~row in blocks of two */
    double threshold;
    double main[BLOCK], side[BLOCK]; /* the blocks of D that belong to the current pivots; side 0 where single */
    int start;                       /* first of these pivots */
    statistics *told;
} front;

static double *column_of(const front *f, int j) { return f->entries + (size_t)j * (size_t)f->stride; }

/* The step that row i belongs to. */
static int step_of(int i) { return i & ~(STEP - 1); }

static double larger(double a, double b) { return a > b ? a : b; }

/* Exchange two rows and columns, p < q. */
static void exchange(front *f, int p, int q)
{
    if (p == q) return;
    const size_t stride = (size_t)f->stride;
    double *a = f->entries, swap;
    for (int k = 0; k < p; k++) {
        double *c = a + k * stride;
        swap = c[p], c[p] = c[q], c[q] = swap;
    }
    double *cp = a + p * stride, *cq = a + q * stride;
    swap = cp[p], cp[p] = cq[q], cq[q] = swap;
    for (int k = p + 1; k < q; k++) {
        double *c = a + k * stride;
        swap = cp[k], cp[k] = c[q], c[q] = swap;
    }
    for (int k = q + 1; k < f->size; k++) swap = cp[k], cp[k] = cq[k], cq[k] = swap;
    swap = f->taken[p], f->taken[p] = f->taken[q], f->taken[q] = swap;
    const int row = f->rows[p];
    f->rows[p] = f->rows[q];
    f->rows[q] = row;
}

/* What stands beside the diagonal entry of column j in the part that is not eliminated yet (from row k). */
typedef struct {
    int partner;   /* row of the largest entry before `end`, -1 if they are all zero */
    double most;   /* the largest entry */
    double others; /* the largest one beside that of the partner */
} surroundings;

static surroundings look_around(const front *f, int k, int end, int j)
{
    surroundings seen = {-1, 0.0, 0.0};
    double best = 0.0, second = 0.0;
    const size_t stride = (size_t)f->stride;
    const double *row = column_of(f, k) + j, *c = column_of(f, j);
    for (int i = k; i < j; i++, row += stride) {
        const double v = fabs(*row);
        if (v > best) second = best, best = v, seen.partner = i;
        else if (v > second) second = v;
    }
    for (int i = j + 1; i < end; i++) {
        const double v = fabs(c[i]);
        if (v > best) second = best, best = v, seen.partner = i;
        else if (v > second) second = v;
    }
    double even = 0.0, odd = 0.0;
    int i = end;
    for (; i + 1 < f->size; i += 2) even = larger(fabs(c[i]), even), odd = larger(fabs(c[i + 1]), odd);
    if (i < f->size) even = larger(fabs(c[i]), even);
    seen.others = larger(larger(even, odd), second);
    seen.most = larger(best, seen.others);
    return seen;
}

/* How good a pivot is: `pivot` over the largest entry, both as they are without a division. */
typedef struct {
    double pivot, most;
} merit;

static int is_at_least(merit m, double threshold) { return m.pivot >= threshold * m.most && m.pivot > 0.0; }

static double quotient(merit m) { return m.pivot == 0.0 ? 0.0 : m.most == 0.0 ? DBL_MAX : m.pivot / m.most; }

/* That of a block of two: 1 over the largest entry that it makes in the factor. */
static merit merit_of_pair(double a, double b, double c, double beside_a, double beside_c, double taken_a,
                           double taken_c)
{
    const double product = a * c, square = b * b, determinant = product - square;
    const merit none = {0.0, 0.0};
    if (!(fabs(determinant) > CANCELLED * (fabs(product) + square))) return none;
    /* terms that were taken off b are at most the geometric mean of those that were taken off a and c */
    const double rounded = ROUNDED * (fabs(c) * taken_a + fabs(a) * taken_c);
    if (!(fabs(determinant) > rounded) || !(fabs(determinant) > ROUNDED * ROUNDED * taken_a * taken_c)) return none;
    const double one = fabs(c) * beside_a + fabs(b) * beside_c, two = fabs(b) * beside_a + fabs(a) * beside_c;
    const merit found = {fabs(determinant), one > two ? one : two};
    return found;
}

/* The pivot to take next among columns k ... end - 1: `first`, with `second` where it has two rows, else -1. They are
 * asked in turn, from column `turn` on, where the last search ended: what was no pivot is asked again when all others had
 * their turn. Returns 0 if none is acceptable, -1 if a number is not finite. */
static int find_pivot(const front *f, int k, int end, int *turn, int *first, int *second)
{
    double best = 0.0;
    const double good = f->threshold > GOOD ? f->threshold : GOOD;
    if (*turn < k || *turn >= end) *turn = k;
    for (int asked = k; asked < end; asked++, *turn = *turn + 1 < end ? *turn + 1 : k) {
        const int j = *turn;
        const surroundings seen = look_around(f, k, end, j);
        const double own = fabs(*(column_of(f, j) + j));
        if (!(seen.most <= DBL_MAX) || !(own <= DBL_MAX)) return -1;
        const int counts = own >= DBL_MIN && own > ROUNDED * f->taken[j]; /* and has a finite inverse */
        const merit single = {counts ? own : 0.0, seen.most};
        if (is_at_least(single, good)) {
            *first = j, *second = -1;
            return 1;
        }
        if (single.pivot > best * single.most) best = quotient(single), *first = j, *second = -1;
        const int partner = seen.partner;
        if (partner < 0) continue;
        const int low = partner < j ? partner : j, high = partner < j ? j : partner;
        double *shared = column_of(f, low) + high;
        const double a = *(column_of(f, low) + low), b = *shared, c = *(column_of(f, high) + high);
        *shared = 0.0; /* what is beside both rows is asked for */
        const double beside = look_around(f, k, end, partner).most;
        *shared = b;
        const double at_low = partner < j ? beside : seen.others, at_high = partner < j ? seen.others : beside;
        const merit pair = merit_of_pair(a, b, c, at_low, at_high, f->taken[low], f->taken[high]);
        if (pair.pivot > best * pair.most) {
            *first = low, *second = high;
            if (is_at_least(pair, good)) return 1;
            best = quotient(pair);
        }
    }
    return best > 0.0 && best >= f->threshold;
}

/* One column, and two neighbours, less multiples of the columns of a pivot. */
static void subtract_one(int from, int end, const double *restrict c, double s, double *restrict to)
{
    for (int r = from; r < end; r += STEP)
        for (int q = r; q < r + STEP; q++) to[q] -= c[q] * s;
}

static void subtract_from_two(int from, int end, const double *restrict c, double s, double t, double *restrict to,
                              double *restrict next)
{
    for (int r = from; r < end; r += STEP)
        for (int q = r; q < r + STEP; q++) {
            to[q] -= c[q] * s;
            next[q] -= c[q] * t;
        }
}

static void subtract_two(int from, int end, const double *restrict c, const double *restrict d, double s, double t,
                         double *restrict to)
{
    for (int r = from; r < end; r += STEP)
        for (int q = r; q < r + STEP; q++) to[q] -= c[q] * s + d[q] * t;
}

/* Zeros above row k of its column, where the substitution begins with this or the column before. */
static void clear_above(double *c, int k)
{
    for (int i = k > 0 ? step_of(k - 1) : 0; i < k; i++) c[i] = 0.0;
}

/* Eliminate row k; the columns before `end` are updated. The inverse of the pivot takes its place. */
static void eliminate_one(front *f, int k, int end)
{
    double *restrict c = column_of(f, k);
    const double pivot = c[k], inverse = 1.0 / pivot;
    const int size = f->size, stride = f->stride;
    int j = k + 1;
    for (; j + 1 < end; j += 2) {
        if (c[j] == 0.0 && c[j + 1] == 0.0) continue;
        double *to = column_of(f, j);
        subtract_from_two(step_of(j), stride, c, c[j] * inverse, c[j + 1] * inverse, to, to + stride);
    }
    if (j < end && c[j] != 0.0) subtract_one(step_of(j), stride, c, c[j] * inverse, column_of(f, j));
    clear_above(c, k);
    double *restrict taken = f->taken;
    for (int i = k + 1; i < size; i++) {
        const double whole = c[i];
        c[i] = whole * inverse;
        taken[i] += fabs(whole * c[i]);
    }
    c[k] = inverse;
    f->main[k - f->start] = pivot;
    f->side[k - f->start] = 0.0;
    f->told->negative += pivot < 0.0;
}

/* Eliminate rows k and k + 1 together. */
static void eliminate_two(front *f, int k, int end)
{
    double *restrict p = column_of(f, k), *restrict q = column_of(f, k + 1);
    const double a = p[k], b = p[k + 1], c = q[k + 1], ra = a / b, rc = c / b, rest = ra * rc - 1.0;
    const double ia = rc / rest / b, ib = -1.0 / rest / b, ic = ra / rest / b;
    const int size = f->size, stride = f->stride;
    for (int j = k + 2; j < end; j++) {
        if (p[j] == 0.0 && q[j] == 0.0) continue;
        subtract_two(step_of(j), stride, p, q, p[j] * ia + q[j] * ib, p[j] * ib + q[j] * ic, column_of(f, j));
    }
    clear_above(p, k);
    clear_above(q, k + 1);
    double *restrict taken = f->taken;
    for (int i = k + 2; i < size; i++) {
        const double x = p[i], y = q[i];
        p[i] = x * ia + y * ib;
        q[i] = x * ib + y * ic;
        taken[i] += fabs(x * p[i]) + fabs(y * q[i]);
    }
    p[k] = ia;
    p[k + 1] = ib;
    q[k + 1] = ic;
    f->main[k - f->start] = a;
    f->side[k - f->start] = b;
    f->main[k + 1 - f->start] = c;
    f->side[k + 1 - f->start] = 0.0;
    f->rows[k] = ~f->rows[k];
    f->told->negative += rest < 0.0 ? 1 : a < 0.0 ? 2 : 0;
    f->told->blocks++;
}

/* Eliminate what can be eliminated among columns k ... end - 1; returns how many columns are done, -1 if a number is not
 * finite. */
static int eliminate_block(front *f, int k, int end)
{
    int turn = k;
    const int reach = f->size <= SMALL ? f->size : end;
    f->start = k;
    while (k < end) {
        int first = k, second = -1;
        const int found = find_pivot(f, k, end, &turn, &first, &second);
        if (found < 0) return -1;
        if (found == 0) break;
        if (second < 0) {
            exchange(f, k, first);
            eliminate_one(f, k++, reach);
        } else {
            exchange(f, k, first); /* first < second, so the second is still where it was */
            exchange(f, k + 1, second);
            eliminate_two(f, k, reach);
            k += 2;
        }
    }
    return k;
}

/* Row j of L D for the current pivots; tells whether any of it is not zero. */
static int weights(const front *f, int pivots, int j, double *w)
{
    int any = 0;
    for (int k = 0; k < pivots; k++) {
        const double l = column_of(f, f->start + k)[j];
        if (f->side[k] != 0.0) {
            const double m = column_of(f, f->start + k + 1)[j];
            w[k] = f->main[k] * l + f->side[k] * m;
            w[k + 1] = f->side[k] * l + f->main[k + 1] * m;
            any |= w[k] != 0.0 || w[k + 1] != 0.0;
            k++;
        } else {
            w[k] = f->main[k] * l;
            any |= w[k] != 0.0;
        }
    }
    return any;
}

/* Two columns less the product of the pivots' columns and the weights of both, from row i on. */
static void subtract_pair(int i, int end, size_t stride, int pivots, const double *l, const double *v, const double *w,
                          double *restrict to, double *restrict next)
{
    int k = 0;
    for (; k + 3 < pivots; k += 4) {
        const double *restrict a = l + k * stride, *restrict b = a + stride;
        const double *restrict c = b + stride, *restrict d = c + stride;
        const double va = v[k], vb = v[k + 1], vc = v[k + 2], vd = v[k + 3];
        const double wa = w[k], wb = w[k + 1], wc = w[k + 2], wd = w[k + 3];
        for (int r = i; r < end; r += STEP)
            for (int q = r; q < r + STEP; q++) {
                to[q] -= a[q] * va + b[q] * vb + c[q] * vc + d[q] * vd;
                next[q] -= a[q] * wa + b[q] * wb + c[q] * wc + d[q] * wd;
            }
    }
    for (; k < pivots; k++) subtract_from_two(i, end, l + k * stride, v[k], w[k], to, next);
}

/* The rest of the front less what the current pivots contribute: columns from `from` on. */
static void update_rest(front *f, int pivots, int from)
{
    double v[BLOCK], w[BLOCK];
    const int size = f->size, stride = f->stride;
    const double *l = column_of(f, f->start);
    for (int j = from; j < size; j += 2) {
        double *to = column_of(f, j);
        const int any = weights(f, pivots, j, v);
        if (j + 1 == size) {
            for (int k = 0; any && k < pivots; k++) to[j] -= l[(size_t)k * (size_t)stride + j] * v[k];
            break;
        }
        if (!weights(f, pivots, j + 1, w) && !any) continue;
        subtract_pair(step_of(j), stride, (size_t)stride, pivots, l, v, w, to, to + stride);
    }
}

/* Bring to the front two columns of which each has its largest entry, among those that may be eliminated, in the other:
 * the pair to try when blocks of neighbours found no pivot. */
static void bring_best_pair(front *f, int k)
{
    int j = k, partner = -1;
    double reached = 0.0;
    for (;;) {
        const int next = look_around(f, k, f->assembled, j).partner;
        if (next < 0 || next == partner) break;
        const double size = fabs(next < j ? column_of(f, next)[j] : column_of(f, j)[next]);
        if (!(size > reached)) break;
        reached = size;
        partner = j;
        j = next;
    }
    if (partner < 0) return;
    const int low = j < partner ? j : partner, high = j < partner ? partner : j;
    exchange(f, k, low);
    exchange(f, k + 1, high);
}

/* Eliminate what can be eliminated of a front; returns how many columns, -1 if a number is not finite. */
static int eliminate_front(front *f)
{
    int done = 0, failed = 0, tried_best = 0;
    while (done < f->assembled) {
        const int left = f->assembled - done;
        const int end = done + (left < BLOCK ? left : BLOCK);
        const int now = eliminate_block(f, done, end);
        if (now < 0) return -1;
        const int pivots = now - done, rest = end - now;
        if (pivots > 0 && f->size > SMALL) update_rest(f, pivots, end);
        if (end == f->assembled && left <= BLOCK) return now; /* all were compared with all, after the last pivot */
        failed = pivots > 0 ? 0 : failed + rest;
        done = now;
        if (pivots > 0) tried_best = 0;
        if (failed >= f->assembled - done) {
            if (tried_best) return done;
            bring_best_pair(f, done);
            tried_best = 1;
        } else
            for (int k = 0; k < rest && done + k < f->assembled - 1 - k; k++)
                exchange(f, done + k, f->assembled - 1 - k); /* others have their turn */
    }
    return done;
}

/* ----------------------------------------------------------------------------------------- from front to front */

/* A front leaves a record behind: size, pivots, where its factor begins, its rows, and its size again, so that records
 * can be read backwards. What it hands to its parent lies at the end of both arrays as on a stack: in the real one the
 * rest of the front by columns, in the integer one which front it was, how many columns were delayed, and these. */
enum { RECORD = 4, HANDED = 2 };

typedef struct {
    const plan *p;
    double *reals;
    double *taken;                   /* of all rows of the matrix; see front */
    int *records;
    int64_t used, stack;             /* of the real array: end of the factor, begin of the stack */
    int64_t recorded, descriptions;  /* the same for the integer array */
} store;

/* Add what a child hands on to its parent's front and take it off the stack. */
static void take_from_child(store *s, front *parent, int delayed, int *delayed_before)
{
    const plan *p = s->p;
    const int *description = s->records + s->descriptions;
    const int child = description[0], own = description[1];
    const int below = p->rows_start[child + 1] - p->rows_start[child];
    const int *place = p->place + p->rows_start[child];
    const double *block = s->reals + s->stack;
    const int at = *delayed_before;
    for (int k = 0; k < own; k++) {
        double *to = column_of(parent, at + k);
        parent->rows[at + k] = description[HANDED + k];
        for (int i = k; i < own; i++) to[at + i] += *block++;
        to += delayed;
        for (int i = 0; i < below; i++) to[place[i]] += *block++;
    }
    for (int k = 0; k < below; k++) {
        double *restrict to = column_of(parent, delayed + place[k]) + delayed;
        const int count = below - k;
        if (place[below - 1] - place[k] == count - 1) { /* neighbours there too */
            double *restrict row = to + place[k];
            for (int i = 0; i < count; i++) row[i] += block[i];
        } else
            for (int i = 0; i < count; i++) to[place[k + i]] += block[i];
        block += count;
    }
    s->stack += (int64_t)(own + below) * (own + below + 1) / 2;
    s->descriptions += HANDED + own;
    *delayed_before += own;
}

/* Add the entries of the matrix that belong to front f. */
static void take_entries(const store *s, front *to, int f, int delayed)
{
    const plan *p = s->p;
    const int *entry = p->entry, *target = p->target;
    const int begin = p->entry_start[f], end = p->entry_start[f + 1];
    if (delayed == 0) {
        for (int k = begin; k < end; k++) to->entries[target[k]] += s->reals[entry[k]];
        return;
    }
    const int planned = stride_of(to->size - delayed);
    for (int k = begin; k < end; k++)
        column_of(to, target[k] / planned + delayed)[target[k] % planned + delayed] += s->reals[entry[k]];
}

/* Put what is left of a front on the stack. It may overlap with the front: the last column is moved first. */
static void hand_on(store *s, const front *f, int number, int done)
{
    const int rest = f->size - done, delayed = f->assembled - done;
    for (int k = rest - 1; k >= 0; k--) {
        s->stack -= rest - k;
        memmove(s->reals + s->stack, column_of(f, done + k) + done + k, sizeof(double) * (size_t)(rest - k));
    }
    s->descriptions -= HANDED + delayed;
    int *description = s->records + s->descriptions;
    memmove(description + HANDED, f->rows + done, sizeof(int) * (size_t)delayed);
    description[0] = number;
    description[1] = delayed;
}

static int all_finite(const double *values, int count)
{
    double sum[8] = {0.0}; /* a product with zero is zero, unless a number is not finite */
    int k = 0;
    for (; k + 7 < count; k += 8)
        for (int q = 0; q < 8; q++) sum[q] += 0.0 * values[k + q];
    for (; k < count; k++) sum[0] += 0.0 * values[k];
    for (int q = 1; q < 8; q++) sum[0] += sum[q];
    return sum[0] == 0.0;
}

enum outcome factor(const plan *p, double *reals, int64_t real_length, int *records, int64_t record_length,
                    double threshold, statistics *told)
{
    const int64_t entries = stride_of(p->nz);
    store s = {p, reals, reals + entries, records, entries + stride_of(p->n), real_length, 0, record_length};
    front now;
    memset(told, 0, sizeof *told);
    told->wanted = (int64_t)p->reals + s.used;
    if (real_length < told->wanted) return SHORT_REALS;
    now.threshold = threshold;
    now.told = told;
    told->wanted = p->integers;
    if (record_length < told->wanted) return SHORT_INTEGERS;
    if (!all_finite(reals, p->nz)) return SINGULAR;
    memset(s.taken, 0, sizeof(double) * (size_t)p->n);
    for (int f = 0; f < p->fronts; f++) {
        const int columns = p->first[f + 1] - p->first[f], below = p->rows_start[f + 1] - p->rows_start[f];
        int delayed = 0, delayed_before = 0;
        int64_t description = s.descriptions;
        for (int c = 0; c < p->children[f]; c++) {
            delayed += records[description + 1];
            description += HANDED + records[description + 1];
        }
        const int size = delayed + columns + below, stride = stride_of(size);
        const int64_t square = (int64_t)size * stride;
        if (size > LARGEST) return TOO_LARGE;
        /* where delays fill the arrays, the rest of the tree will need more too: ask for a part of what is known */
        told->wanted = real_length + real_length / 2 + square + stride;
        if (s.used + square + stride > s.stack) return SHORT_REALS;
        told->wanted = record_length + record_length / 2 + 2 * (int64_t)size;
        if (s.recorded + RECORD + 2 * (int64_t)size + HANDED > s.descriptions) return SHORT_INTEGERS;

        int *record = records + s.recorded;
        now.entries = reals + s.used;
        now.size = size;
        now.stride = stride;
        now.assembled = delayed + columns;
        now.rows = record + 3;
        now.taken = now.entries + square;
        memset(now.entries, 0, sizeof(double) * (size_t)(square + stride));
        memcpy(now.rows + delayed, p->order + p->first[f], sizeof(int) * (size_t)columns);
        memcpy(now.rows + delayed + columns, p->rows + p->rows_start[f], sizeof(int) * (size_t)below);
        take_entries(&s, &now, f, delayed);
        for (int c = 0; c < p->children[f]; c++) take_from_child(&s, &now, delayed, &delayed_before);
        for (int k = 0; k < now.assembled; k++) {
            now.taken[k] = s.taken[now.rows[k]];
            s.taken[now.rows[k]] = 0.0;
        }
        const int done = eliminate_front(&now);
        if (done < 0) {
            told->negative = 0; /* nothing is known */
            return SINGULAR;
        }
        if (below == 0) told->missing += now.assembled - done; /* nothing is left to couple with */
        for (int k = done; k < size; k++) s.taken[now.rows[k]] += now.taken[k];
        if (below > 0) hand_on(&s, &now, f, done);
        record[0] = size;
        record[1] = done;
        record[2] = (int)s.used;
        record[3 + size] = size;
        s.recorded += RECORD + size;
        s.used += (int64_t)stride * done;
        if (below > 0) told->delayed += now.assembled - done;
        if (size > told->largest) told->largest = size;
        told->entries += (double)size * done - 0.5 * (double)done * (done - 1);
        told->operations += 0.5 * (double)done * size * size;
    }
    return told->missing > 0 ? SINGULAR : DONE;
}
