
/* Model exchange */

FUNCTION(fmi2EnterEventMode)(Unit *unit) {
    UNUSED(unit);
    return OK;
}

FUNCTION(fmi2NewDiscreteStates)(Unit *unit, EventInfo *info) {
    UNUSED(unit);
    memset(info, 0, sizeof *info);
    return OK;
}

FUNCTION(fmi2EnterContinuousTimeMode)(Unit *unit) {
    UNUSED(unit);
    return OK;
}

FUNCTION(fmi2CompletedIntegratorStep)(Unit *unit, Boolean noSet, Boolean *enterEventMode, Boolean *terminate) {
    UNUSED(unit), UNUSED(noSet);
    *enterEventMode = *terminate = 0;
    return OK;
}

FUNCTION(fmi2SetTime)(Unit *unit, double time) {
    UNUSED(unit), UNUSED(time);
    return OK;
}

FUNCTION(fmi2SetContinuousStates)(Unit *unit, const double x[], size_t n) {
    if (n != N_X) return fail(unit, "there are more or fewer states");
    memcpy(unit->data.v + X, x, N_X * sizeof *x);
    unit->data.stale = 1;
    return OK;
}

FUNCTION(fmi2GetContinuousStates)(Unit *unit, double x[], size_t n) {
    if (n != N_X) return fail(unit, "there are more or fewer states");
    refresh(&unit->data);
    memcpy(x, unit->data.v + X, N_X * sizeof *x);
    return OK;
}

FUNCTION(fmi2GetDerivatives)(Unit *unit, double dx[], size_t n) {
    if (n != N_X) return fail(unit, "there are more or fewer states");
    refresh(&unit->data);
    memcpy(dx, unit->data.v + DX, N_X * sizeof *dx);
    return OK;
}

FUNCTION(fmi2GetNominalsOfContinuousStates)(Unit *unit, double x[], size_t n) {
    if (n != N_X) return fail(unit, "there are more or fewer states");
    memcpy(x, NOMINAL, N_X * sizeof *x);
    return OK;
}

FUNCTION(fmi2GetEventIndicators)(Unit *unit, double z[], size_t n) {
    UNUSED(z);
    return n ? fail(unit, "there are no event indicators") : OK;
}
