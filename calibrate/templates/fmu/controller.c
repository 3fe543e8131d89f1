
/* A controller: a sample every PERIOD, the first one at the start, its outputs held from one to the next */

#define EARLY (1e-6 * PERIOD) /* sums of communication steps miss a sample by rounding */

static void sample(Data *d, double later, double *next) {
    double u[N_U], found[N_Y + N_X];
    for (int i = 0; i < N_U; ++i) u[i] = d->v[U + i] + d->rates[i] * later;
    if (d->starting) vg_start(d->v, u, d->v + X);
    vg_update(d->v, u, d->v + X, found);
    memcpy(d->v + Y, found, N_Y * sizeof *found);
    memcpy(next, found + N_Y, N_X * sizeof *found);
}

/* At a sample, inputs that were set show in the outputs at once; what is remembered goes on with the step. */
static void refresh(Data *d) {
    double unused[N_X];
    if (d->stale && d->due < EARLY) sample(d, 0.0, unused);
    d->stale = 0;
}

static String advance(Data *d, double duration) {
    for (; d->due < duration - EARLY; d->due += PERIOD) {
        double next[N_X];
        sample(d, d->due, next);
        memcpy(d->v + X, next, sizeof next);
        d->starting = 0;
    }
    d->due -= duration;
    d->stale = 0; /* outputs are those that held over the step */
    return NULL;
}
