
/* A plant: the library's integrator */

enum { MAX_STEP = SETTINGS, ATMOSPHERE };

static void read_inputs(const Data *d, double duration, double *u) {
    u[0] = duration;
    u[1] = d->v[ATMOSPHERE] - STANDARD_ATMOSPHERE;
    for (int i = 0; i < N_U; ++i) {
        u[2 + 2 * i] = d->v[U + i];
        u[3 + 2 * i] = IS_HELD[i] ? 0.0 : d->rates[i];
    }
}

static void refresh(Data *d) {
    double u[2 + 2 * N_U];
    if (!d->stale) return;
    read_inputs(d, 0.0, u);
    if (d->starting) vg_start(d->v, d->v + S, u, d->v + X);
    vg_reports(d->v, u, d->v + X, d->v + Y);
    vg_derivatives(d->v, u, d->v + X, d->v + DX);
    d->stale = 0;
}

static String advance(Data *d, double duration) {
    double u[2 + 2 * N_U], next[N_X];
    if (!(d->v[MAX_STEP] > 0)) return "max_step must be positive";
    const double steps = ceil(duration / d->v[MAX_STEP] * (1 - 1e-9));
    const double length = duration / (steps < 1 ? 1 : steps);
    read_inputs(d, duration, u);
    for (double i = 0; i < steps || i < 1; ++i) {
        vg_step(d->v, u, d->v + X, i * length, length, next);
        memcpy(d->v + X, next, sizeof next);
    }
    d->stale = 1;
    return NULL;
}
