#include "isolation_fit.h"

#define MOST_HALVINGS 40

/* Natural logarithm of a number from 1 to 1e12, to 1e-4. */
static amb_real logarithm(amb_real x)
{
  amb_real sum = AMB_C(0.0);
  amb_real m = x;
  for (int k = 0; k < MOST_HALVINGS; k++) {
    if (m > AMB_C(1.5)) {
      m *= AMB_C(0.5);
      sum += AMB_C(0.6931471805599453);
    }
  }
  const amb_real q = (m - AMB_C(1.0)) / (m + AMB_C(1.0));
  return sum + (AMB_C(2.0) * q * (AMB_C(1.0) + (q * q / AMB_C(3.0))));
}

/* Likelihood ratio of a larger variance of the last innovations to the stated one. */
static amb_real too_large(const amb_isolation *iso, int samples, amb_real energy)
{
  const amb_real number = (amb_real)samples * (amb_real)iso->sensors;
  const amb_real mean = amb_clamp(energy / number, AMB_C(1.0), AMB_C(1e12));
  return number * (mean - AMB_C(1.0) - logarithm(mean));
}

/* Keep the best likelihood of each fault. */
static void keep_best(const amb_isolation *iso, const sweep *w, int since, bool before,
                      amb_isolation_result result[])
{
  for (int j = 0; j < iso->faults; j++) {
    const int own = (int)iso->fault[j].column;
    const amb_real M = entry(iso, w, own, own);
    const amb_real g = w->g[own];
    const amb_real by_itself = (M > AMB_C(0.0)) ? ((g * g) / M) : AMB_C(0.0);
    const bool one = iso->fault[j].columns == 1U;
    const amb_real l = one ? by_itself : amb_fit_likelihood(iso, w, j, -1, NULL, NULL);
    if (l > result[j].likelihood) {
      result[j].likelihood = l;
      result[j].since = since;
      result[j].before = before;
    }
  }
}

static int samples_in(const amb_isolation *iso, const amb_isolation_state *state)
{
  const int filled = state->filled - 1; /* the first has no past */
  return (filled < iso->window) ? filled : iso->window;
}

static void name_none(const amb_isolation *iso, amb_isolation_result result[])
{
  for (int j = 0; j < iso->faults; j++) {
    amb_isolation_result *of = &result[j];
    of->likelihood = AMB_C(0.0);
    amb_clear(2, of->size);
    amb_clear(2, of->variance);
    of->since = 0;
    of->before = false;
    of->instead = -1;
  }
}

static int likeliest(const amb_isolation *iso, const amb_isolation_result result[])
{
  int first = 0;
  for (int j = 1; j < iso->faults; j++) {
    first = (result[j].likelihood > result[first].likelihood) ? j : first;
  }
  return first;
}

/* The first sweep: likelihood and onset of each fault by its linearised signature. Returns the
 * likeliest. */
static int sweep_singles(window *in, amb_isolation_result result[])
{
  const amb_isolation *iso = in->data.iso;
  amb_real largest = AMB_C(0.0);
  sweep w = amb_sweep_begin(&in->data, false);
  in->begin = in->samples;
  for (int ago = 0; ago < in->samples; ago++) {
    amb_sweep_back(&in->data, ago, &w);
    if ((ago + 1) >= AMB_ISOLATION_LEAST) {
      const amb_real large = too_large(iso, ago + 1, w.energy);
      in->begin = (large > largest) ? (ago + 1) : in->begin;
      largest = amb_at_least(large, largest);
      keep_best(iso, &w, ago + 1, false, result);
    }
  }
  in->unexplained = w.energy;
  const amb_real start = amb_sweep_eliminate_start(iso, &w);
  int first = likeliest(iso, result);
  if ((start - (amb_real)iso->states) > (result[first].likelihood - iso->margin)) {
    in->unexplained -= start; /* an error at its start explains as much as a fault within it */
    name_none(iso, result);
    keep_best(iso, &w, in->samples, true, result);
    first = likeliest(iso, result);
  }
  return first;
}

/* Share of what fault k explains by which j must differ from it. */
static amb_real share_of(const window *in, int j, int k)
{
  return amb_fit_alike(in->data.iso, j, k) ? in->data.iso->alike : in->share;
}

/* What fault k of a pair explains beyond the other. */
static amb_real adds(const pair *two, int k, const amb_isolation_result result[])
{
  return two->fit.explains - result[two->of[1 - k]].likelihood;
}

/* Whether the pair explains so much more than any single fault that both are named. */
static bool needs_two(const window *in, const amb_isolation_result result[], const pair *two,
                      amb_real scale)
{
  const amb_isolation *iso = in->data.iso;
  bool needed = !amb_fit_alike(iso, two->of[0], two->of[1]);
  for (int j = 0; j < iso->faults; j++) {
    amb_real least = amb_at_least(iso->limit * scale, AMB_C(2.0) * in->share * two->fit.explains);
    least = amb_at_least(least, AMB_C(3.0) * amb_fit_missed(in, &two->fit, scale));
    for (int k = 0; k < 2; k++) {
      const bool alike = amb_fit_alike(iso, j, two->of[k]);
      least = alike ? amb_at_least(least, iso->alike * adds(two, k, result)) : least;
    }
    needed = needed && ((two->fit.explains - result[j].likelihood) >= least);
  }
  return needed;
}

/* The fault of the best pair that j can replace: beside the other one of the pair, or beside any
 * fault; -1: none. */
static int instead_of_two(const window *in, int j, const pairs *list, amb_real least,
                          const amb_isolation_result result[])
{
  const pair *two = &list->likely[list->best];
  const amb_real most = two->fit.explains;
  const amb_real less = amb_at_most(adds(two, 0, result), adds(two, 1, result));
  int place = -1;
  int any = -1;
  amb_real best = AMB_C(0.0);
  for (int q = 0; q < list->count; q++) {
    const pair *other = &list->likely[q];
    const amb_real both = other->fit.explains;
    const bool has = (other->of[0] == j) || (other->of[1] == j);
    for (int k = 0; has && (k < 2); k++) {
      const int beside = (other->of[0] == j) ? other->of[1] : other->of[0];
      const amb_real margin =
          amb_at_least(least, share_of(in, j, two->of[k]) * adds(two, k, result));
      if ((beside == two->of[1 - k]) && (both > best) && ((most - both) < margin)) {
        best = both;
        place = two->of[k];
      }
    }
    any = (has && ((most - both) < amb_at_least(least, in->share * less))) ? two->of[0] : any;
  }
  return (place >= 0) ? place : any;
}

static void name_two(const window *in, const pairs *list, amb_real least,
                     amb_isolation_result result[])
{
  const pair *two = &list->likely[list->best];
  for (int j = 0; j < in->data.iso->faults; j++) {
    result[j].instead = instead_of_two(in, j, list, least, result);
  }
  const int own = (int)in->data.iso->fault[two->of[0]].columns;
  amb_fit_write(&two->fit, 0, own, &result[two->of[0]]);
  amb_fit_write(&two->fit, own, two->fit.columns - own, &result[two->of[1]]);
}

/* The likeliest fault is named; another one is possible instead if it explains as much, or is one
 * of two that explain more together. */
static void name_one(const window *in, int first, const pairs *list, amb_real least,
                     amb_isolation_result result[])
{
  const amb_real most = result[first].likelihood;
  const amb_real both = list->likely[list->best].fit.explains;
  const amb_real of_two = amb_at_least(least, AMB_C(0.5) * in->share * both);
  for (int j = 0; j < in->data.iso->faults; j++) {
    const amb_real margin = amb_at_least(least, share_of(in, j, first) * most);
    result[j].instead = ((most - result[j].likelihood) < margin) ? first : -1;
  }
  const bool doubtful = (both - most) >= of_two;
  for (int k = 0; doubtful && (k < list->count); k++) {
    const pair *two = &list->likely[k];
    if ((both - two->fit.explains) < of_two) {
      result[two->of[0]].instead = first;
      result[two->of[1]].instead = first;
    }
  }
}

/* Name the likeliest fault or the likeliest two; returns how many, and the scale of the
 * innovations. */
static int name_likeliest(window *in, int of, amb_isolation_result result[], amb_real *scale)
{
  const amb_isolation *iso = in->data.iso;
  const bool before = result[of].before;
  int first = of;
  int named = 1;
  pairs list;
  if (before) {
    in->share = iso->like;
  } else {
    in->share = iso->fine;
    first = amb_fit_singles(in, of, result);
    *scale = amb_fit_scale(in, result[first].likelihood);
  }
  amb_fit_pairs(in, first, result, &list);
  const pair *two = &list.likely[list.best];
  const amb_real scale_of_two = amb_fit_scale(in, two->fit.explains);
  if (needs_two(in, result, two, scale_of_two)) {
    *scale = scale_of_two;
    const amb_real margin = iso->margin * scale_of_two;
    name_two(in, &list, amb_at_least(margin, amb_fit_missed(in, &two->fit, scale_of_two)), result);
    named = 2;
  } else {
    const amb_real margin = iso->margin * *scale;
    name_one(in, first, &list, amb_at_least(margin, in->missed), result);
  }
  return named;
}

int amb_isolation_evaluate(const amb_isolation *iso, const amb_isolation_state *state,
                           const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                           amb_isolation_result result[])
{
  const unsigned int count = state->count;
  window in;
  in.samples = samples_in(iso, state); /* first: more may come in between */
  in.data = (samples){iso, state, kf, magnet, state->newest};
  in.roughness = AMB_C(1.0);
  for (int r = 0; r < iso->sensors; r++) {
    in.roughness = amb_at_least(in.roughness, state->roughness[r]);
  }
  in.share = iso->like;
  in.missed = AMB_C(0.0);
  name_none(iso, result);
  if ((in.samples < AMB_ISOLATION_LEAST) || (state->contact < free_of(iso))) {
    return 0;
  }
  const int first = sweep_singles(&in, result);
  amb_real scale = amb_fit_scale(&in, result[first].likelihood);
  int named = 0;
  if (result[first].likelihood >= (iso->limit * scale)) {
    named = name_likeliest(&in, first, result, &scale);
  }
  for (int j = 0; j < iso->faults; j++) {
    result[j].likelihood /= scale;
    result[j].variance[0] *= scale;
    result[j].variance[1] *= scale;
  }
  if ((state->count - count) > (unsigned int)iso->spare) { /* what was read was written over */
    name_none(iso, result);
    named = -1;
  }
  return named;
}

void amb_isolation_information(const amb_isolation *iso, const amb_isolation_state *state,
                               const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES], int since,
                               bool before, amb_real information[])
{
  const int filled = samples_in(iso, state);
  const samples data = {iso, state, kf, magnet, state->newest};
  const sweep w = amb_sweep_to(&data, (since < filled) ? since : filled, before);
  for (int j = 0; j < iso->columns; j++) {
    for (int l = 0; l < iso->columns; l++) {
      information[(j * iso->columns) + l] = entry(iso, &w, j, l);
    }
  }
}
