#include "plant.h"
#include "ambkit/root.h"
#include "generated/closed_law.h"

#define AMB_FINEST 4096 /* parts of a substep, in contact with a stop */

/* The rotation at a moment. */
typedef struct amb_turned {
  amb_real speed, cosine, sine;
} amb_turned;

/* What does not change within a stretch in which the demand is held. */
typedef struct amb_going {
  const amb_plant *plant;
  const amb_acts *acts;
  const amb_real *demanded;
  amb_real h, half, sixth;
  amb_real g[AMB_PLANT_STATES];
  amb_real per_mass[AMB_PLANT_STATES], per_lag[AMB_SENSORS];
  bool as_built;                   /* whether magnets have currents, and their own force */
  amb_real growth;                 /* of the speed [rad/s^2] */
  bool turning;                    /* whether anything asks for the angle */
  amb_turned at_sample, turned[3]; /* and at the stages of a substep */
  bool *met;                       /* set where a stage is in a soft stop */
} amb_going;

/* ---- Magnets and amplifiers ---- */

static amb_real velocity(const amb_plant *plant, int f, const amb_real X[])
{
  return amb_plant_along(plant, f, X + plant->positions);
}

static amb_real within(const amb_plant *plant, int f, amb_real s)
{
  return amb_clamp(s, -plant->farthest[f], plant->farthest[f]);
}

static amb_real current(const amb_plant *plant, int f, const amb_real X[], amb_real iu)
{
  const int first = plant->current[f], second = plant->second[f];
  if (first < 0)
    return iu;
  return second < 0 ? X[first] : (X[first] + X[second]) / 2;
}

/* Force of a magnet at the displacement s, relative to its bias force. */
static amb_real pull(const amb_plant *plant, const amb_acts *acts, int f, const amb_real X[],
                     amb_real iu, amb_real s)
{
  const amb_magnet *magnet = &plant->magnet[f], *coil = &plant->coil[f];
  if (acts->off)
    return -plant->bias[f];
  amb_real force;
  if ((plant->second[f] >= 0) && (coil->methods != NULL))
    force = coil->methods->force(coil->self, X[plant->current[f]], s) -
            coil->methods->force(coil->self, -X[plant->second[f]], -s);
  else
    force = magnet->methods->force(magnet->self, current(plant, f, X, iu), s);
  return acts->scale * force + (acts->scale - 1) * plant->bias[f];
}

/* In place of those of axes that share their iron, with the demanded currents iu. */
static void pull_coupled(const amb_plant *plant, const amb_acts *acts, const amb_real X[],
                         const amb_real iu[], const amb_real s[], amb_real F[])
{
  for (int k = 0; (k < plant->couplings) && !acts->off; k++) {
    const amb_coupling *both = &plant->coupling[k];
    const int a = both->first, b = both->second;
    const amb_real i[2] = {current(plant, a, X, iu[a]), current(plant, b, X, iu[b])};
    const amb_real at[2] = {within(plant, a, s[a]), within(plant, b, s[b])};
    amb_real force[2];
    amb_coupling_force(both, i, at, force);
    F[a] = acts->scale * force[0] - plant->bias[a];
    F[b] = acts->scale * force[1] - plant->bias[b];
  }
}

/* Rates of the currents of axis f. */
static void flow(const amb_going *of, int f, const amb_real X[], amb_real s, amb_real d[])
{
  const amb_plant *plant = of->plant;
  const amb_parts *parts = &plant->amplifier[f];
  const int first = plant->current[f], second = plant->second[f];
  const amb_real iu = of->demanded[f], scale = of->acts->scale;
  const amb_real v = parts->voltage > 0 ? velocity(plant, f, X) : 0;
  if (first >= 0)
    d[first] = amb_parts_rate(parts, scale, X[first], iu, s, v);
  if (second >= 0)
    d[second] = -amb_parts_rate(parts, scale, -X[second], -iu, -s, -v);
}

/* ---- Stops ---- */

/* How deep the rotor at these displacements is in a ring [m], 0 where it is clear of it, and the
 * direction. */
static amb_real depth_in(const amb_ring *ring, const amb_real s[], amb_real way[2])
{
  const amb_real a = s[ring->first], b = ring->second < 0 ? 0 : s[ring->second];
  if (!(a * a + b * b > ring->travel * ring->travel))
    return 0;
  const amb_real far = ring->second < 0 ? amb_magnitude(a) : amb_root(a * a + b * b);
  way[0] = a / far;
  way[1] = b / far;
  return far - ring->travel;
}

/* Forces of soft stops on a rotor of this speed [rad/s], added to those along the axes. Returns
 * whether there are any. */
static bool add_contact(const amb_plant *plant, const amb_real s[], const amb_real X[],
                        amb_real speed, amb_real F[])
{
  bool any = false;
  for (int k = 0; k < plant->rings; k++) {
    const amb_ring *ring = &plant->ring[k];
    const amb_parts *stop = ring->stop;
    amb_real way[2];
    const amb_real depth = depth_in(ring, s, way);
    if (depth > 0) {
      const bool two = ring->second >= 0;
      const amb_real v = velocity(plant, ring->first, X);
      const amb_real w = two ? velocity(plant, ring->second, X) : 0;
      const amb_real force = amb_parts_push(stop, depth, way[0] * v + way[1] * w);
      const amb_real slip = speed * stop->radius + way[0] * w - way[1] * v;
      const amb_real rub = stop->friction * force * amb_clamp(slip / AMB_STICKS, -1, 1);
      F[ring->first] -= force * way[0] - rub * way[1];
      if (two)
        F[ring->second] -= force * way[1] + rub * way[0];
      any = any || (stop->stiffness > 0);
    }
  }
  return any;
}

static bool in_contact(const amb_plant *plant, const amb_real X[])
{
  amb_real s[AMB_PLANT_AXES], F[AMB_PLANT_AXES] = {0};
  for (int f = 0; f < plant->axes; f++)
    s[f] = amb_plant_along(plant, f, X);
  return add_contact(plant, s, X, 0, F);
}

/* ---- What the text of the substep asks for ---- */

/* By what the compiler unrolls the text; else loops. */
typedef struct amb_pattern {
  int positions, axes, sensors, states;
  bool own, plain; /* as of amb_plant */
  bool closed;     /* the closed law of two sides, which is known here and not asked by a pointer */
} amb_pattern;

static const amb_pattern closed_axis = {1, 1, 1, 3, true, true, true};
static const amb_pattern plain_axis = {1, 1, 1, 3, true, true, false};
static const amb_pattern axis_with_parts = {1, 1, 1, 5, true, false, false};

/* A stage may look beyond a stop; magnet and sensor of an axis do not find the rotor there. */
AMB_INLINE amb_real amb_reachable(const amb_pattern *p, const amb_going *of, amb_real x, int k)
{
  return p->own ? within(of->plant, k, x) : x;
}

/* `start`, and `by` times what forces do to a position. */
AMB_INLINE amb_real amb_driven(const amb_pattern *p, const amb_going *of, amb_real start,
                               amb_real by, const amb_real F[], int k)
{
  return p->own ? start + by * of->per_mass[k] * F[k]
                : start + by * amb_sparse_times(&of->plant->B, of->plant->B.value, k, F);
}

/* Accelerations of position k by motion and unbalance. */
static amb_real moved(const amb_going *of, const amb_real X[], const amb_turned *now, int k)
{
  const amb_plant *plant = of->plant;
  amb_real sum = 0;
  for (int j = plant->A.start[k]; j < plant->A.start[k + 1]; j++)
    sum += (plant->A.value[j] + now->speed * plant->spin[j]) * X[plant->A.column[j]];
  if (plant->cosine != NULL) {
    const amb_real square = now->speed * now->speed;
    sum += (square * now->cosine + of->growth * now->sine) * plant->cosine[k] +
           (square * now->sine - of->growth * now->cosine) * plant->sine[k];
  }
  return sum;
}

/* Forces, and what changes by itself: accelerations beside g (not of a plain plant), and rates of
 * the states of first order. */
AMB_INLINE void amb_stage(const amb_pattern *p, const amb_going *of, const amb_real X[], int stage,
                          amb_real F[], amb_real d[])
{
  const amb_plant *plant = of->plant;
  const amb_turned *now = &of->turned[stage];
  const int q = p->positions;
  amb_real s[AMB_PLANT_AXES];
  for (int j = 2 * q + p->sensors; j < p->states; j++)
    d[j] = 0;
  for (int f = 0; f < p->axes; f++) {
    s[f] = p->own ? X[f] : amb_sparse_times(&plant->H, plant->H.value, f, X);
    const amb_real at = p->own ? s[f] : within(plant, f, s[f]), iu = of->demanded[f];
    if (p->closed)
      F[f] = amb_law_force((const amb_law *)plant->magnet[f].self, iu, at);
    else if (p->plain && of->as_built)
      F[f] = plant->magnet[f].methods->force(plant->magnet[f].self, iu, at);
    else
      F[f] = pull(plant, of->acts, f, X, iu, at);
  }
  if (!p->own)
    pull_coupled(plant, of->acts, X, of->demanded, s, F);
  if (!p->plain) {
    for (int f = 0; f < p->axes; f++) {
      const amb_real force = F[f];
      flow(of, f, X, p->own ? s[f] : within(plant, f, s[f]), d);
      amb_parts_follow(&plant->amplifier[f], X, force, d);
      F[f] = amb_parts_behind(&plant->amplifier[f], X, force);
    }
    if (add_contact(plant, s, X, now->speed, F))
      *of->met = true;
    for (int k = 0; k < q; k++)
      d[q + k] = p->own ? 0 : moved(of, X, now, k);
  }
  for (int r = 0; r < p->sensors; r++) {
    const amb_real x = p->own ? X[r] : amb_sparse_times(&plant->C, plant->C.value, r, X),
                   K = plant->gain[r];
    const int j = p->own ? 2 * q + r : plant->shows[r];
    const amb_real seen =
        p->plain ? K * x : amb_parts_shown(&plant->sensor[r], K, x, now->cosine, now->sine);
    d[j] = (seen - X[j]) * of->per_lag[r];
  }
}

#include "plant_text.h"

/* ---- One substep ---- */

/* Past the end of its way an isolated axis stays. Returns true where that is touched. */
AMB_INLINE bool stop(const amb_pattern *p, const amb_going *of, amb_real X[])
{
  bool touched = false;
  for (int k = 0; p->own && (k < p->positions); k++) {
    const amb_real end = of->plant->farthest[k];
    amb_real *v = &X[p->positions + k];
    if ((X[k] >= end) || (X[k] <= -end)) {
      X[k] = amb_clamp(X[k], -end, end);
      if (X[k] > 0 ? *v > 0 : *v < 0)
        *v = 0;
      touched = true;
    }
  }
  return touched;
}

static amb_turned turned(const amb_going *of, amb_real t)
{
  const amb_turned *at = &of->at_sample;
  amb_turned now = {at->speed + of->growth * t, at->cosine, at->sine};
  if (of->turning) {
    amb_real c, d;
    amb_parts_turn((at->speed + of->growth * t / 2) * t, &c, &d);
    now.cosine = at->cosine * c - at->sine * d;
    now.sine = at->sine * c + at->cosine * d;
  }
  return now;
}

AMB_INLINE void of_length(amb_going *of, amb_real h)
{
  of->h = h;
  of->half = h / 2;
  of->sixth = h / 6;
}

/* From t after the sample on by h. Returns whether a stage was in a soft stop. */
static bool step(const amb_pattern *p, amb_going *of, amb_real X[], amb_real t, amb_real h)
{
  bool met = false;
  of->met = &met;
  of_length(of, h);
  of->turned[0] = turned(of, t);
  of->turned[1] = turned(of, t + of->half);
  of->turned[2] = turned(of, t + h);
  if (p->states == axis_with_parts.states && p->own)
    amb_substep(&axis_with_parts, of, X);
  else
    amb_substep(p, of, X);
  return met || in_contact(of->plant, X);
}

/* How much all that acts on position k can change its velocity within a second. */
static amb_real strength(const amb_going *of, const amb_real X[], const amb_real F[], int k)
{
  const amb_plant *plant = of->plant;
  amb_real sum = amb_magnitude(of->g[k]);
  if (plant->own)
    return sum + amb_magnitude(of->per_mass[k] * F[k]);
  for (int j = plant->B.start[k]; j < plant->B.start[k + 1]; j++)
    sum += amb_magnitude(plant->B.value[j] * F[plant->B.column[j]]);
  for (int j = plant->A.start[k]; j < plant->A.start[k + 1]; j++)
    sum += amb_magnitude(plant->A.value[j] * X[plant->A.column[j]]);
  return sum;
}

/* Whether a step and its two halves come to the same, to half of the digits. */
static bool agree(const amb_pattern *p, const amb_going *of, const amb_real from[],
                  const amb_real one[], const amb_real two[], amb_real h)
{
  const amb_real tolerance = AMB_ROOT_EPSILON, epsilon = tolerance * tolerance;
  amb_real F1[AMB_PLANT_AXES], F2[AMB_PLANT_AXES], d[AMB_PLANT_STATES];
  amb_stage(p, of, from, 0, F1, d);
  amb_stage(p, of, two, 2, F2, d);
  for (int k = 0; k < p->positions; k++) {
    const int v = p->positions + k;
    const amb_real fast =
        amb_magnitude(from[v]) + h * (strength(of, from, F1, k) + strength(of, two, F2, k));
    const amb_real near = tolerance * h * fast + 4 * epsilon * of->plant->ring[0].travel;
    if (!(amb_magnitude(two[v] - one[v]) <= tolerance * fast) ||
        !(amb_magnitude(two[k] - one[k]) <= near))
      return false;
  }
  return true;
}

/* A step in contact, in as many parts as it takes: halved until a part is what its halves are. The
 * force begins at the stop with the power 3/2, and there it takes small ones. */
static void refined(const amb_pattern *p, amb_going *of, amb_real X[], amb_real t, amb_real h)
{
  int done = 0, size = AMB_FINEST;
  while (done < AMB_FINEST) {
    size = size < (AMB_FINEST - done) ? size : AMB_FINEST - done;
    const amb_real unit = h / AMB_FINEST, from = t + unit * (amb_real)done;
    const amb_real length = unit * (amb_real)size;
    amb_real one[AMB_PLANT_STATES], two[AMB_PLANT_STATES];
    amb_copy(p->states, X, one);
    amb_copy(p->states, X, two);
    (void)step(p, of, one, from, length);
    (void)step(p, of, two, from, length / 2);
    (void)step(p, of, two, from + length / 2, length / 2);
    if ((size > 1) && !agree(p, of, X, one, two, length)) {
      size /= 2;
      continue;
    }
    amb_copy(p->states, two, X);
    (void)stop(p, of, X);
    done += size;
    size *= 2;
  }
}

/* From t after the sample on by a stretch in which the demand is held. */
AMB_INLINE bool stretch(const amb_pattern *p, amb_going *of, amb_real X[], amb_real t,
                        amb_real length, int steps)
{
  const amb_real h = length / (amb_real)steps;
  bool touched = false;
  of_length(of, h);
  for (int n = 0; n < steps; n++) {
    if (p->plain) {
      amb_substep(p, of, X);
      touched |= stop(p, of, X);
    } else {
      const amb_real from = t + h * (amb_real)n;
      amb_real next[AMB_PLANT_STATES];
      amb_copy(p->states, X, next);
      if (step(p, of, next, from, h)) {
        refined(p, of, X, from, h);
        touched = true;
      } else {
        amb_copy(p->states, next, X);
        touched |= stop(p, of, X);
      }
    }
  }
  return touched;
}

/* ---- Between two samples ---- */

static bool asks_for_the_angle(const amb_plant *plant)
{
  bool any = plant->cosine != NULL;
  for (int r = 0; r < plant->sensors; r++)
    any = any || (plant->sensor[r].orders > 0);
  return any;
}

static bool as_built(const amb_acts *acts)
{
  return !acts->off && (acts->scale >= 1) && (acts->scale <= 1);
}

/* What is held throughout. */
AMB_INLINE void prepare(const amb_pattern *p, amb_going *of, const amb_plant *plant,
                        const amb_plant_state *state, amb_real T, const amb_acts *acts)
{
  of->plant = plant;
  of->acts = acts;
  of->demanded = acts->demanded;
  of->as_built = as_built(acts);
  for (int k = 0; k < p->positions; k++) {
    if (p->own) {
      of->g[k] = (plant->g[k] + acts->load[k]) / plant->mass[k];
      of->per_mass[k] = 1 / plant->mass[k];
    } else
      of->g[k] = plant->g[k] + amb_sparse_times(&plant->B, plant->B.value, k, acts->load);
  }
  for (int k = 0; (acts->base != NULL) && (plant->base != NULL) && (k < 3); k++)
    if (plant->base[k] >= 0)
      of->g[plant->base[k]] -= acts->base[k];
  for (int r = 0; r < p->sensors; r++)
    of->per_lag[r] = 1 / plant->lag[r];
  if (!p->plain) {
    const amb_turned now = {acts->speed, state->cosine, state->sine};
    of->at_sample = of->turned[0] = now;
    of->growth = (acts->next - acts->speed) / T;
    of->turning =
        ((acts->speed < 0) || (acts->speed > 0) || (acts->next < 0) || (acts->next > 0)) &&
        asks_for_the_angle(plant);
  }
}

/* How many substeps a part of a sample takes. */
static int steps_in(const amb_plant *plant, amb_real part, amb_real T)
{
  return part < T ? (int)((amb_real)plant->substeps * part / T) + 1 : plant->substeps;
}

/* The demand goes into the line of those that wait. */
static void wait(const amb_plant *plant, amb_plant_state *state, const amb_real demanded[])
{
  for (int n = plant->delay + 1; n > 0; n--)
    amb_copy(plant->axes, state->demanded[n - 1], state->demanded[n]);
  amb_copy(plant->axes, demanded, state->demanded[0]);
}

/* To the angle at the next sample; what rounding did to its length is put right. */
static void rotate(const amb_going *of, amb_plant_state *state, amb_real T)
{
  const amb_turned then = turned(of, T);
  const amb_real right = (3 - (then.cosine * then.cosine + then.sine * then.sine)) / 2;
  state->cosine = right * then.cosine;
  state->sine = right * then.sine;
}

AMB_INLINE bool advance(const amb_pattern *p, const amb_plant *plant, amb_plant_state *state,
                        amb_real T, const amb_acts *acts)
{
  const amb_real rest = plant->delay_rest;
  amb_real X[AMB_PLANT_STATES];
  amb_going of;
  bool touched = false;
  prepare(p, &of, plant, state, T, acts);
  amb_copy(p->states, state->X, X);
  for (int k = 0; p->own && (k < p->positions); k++)
    X[k] = within(plant, k, X[k]);
  if ((plant->delay > 0) || (rest > 0)) {
    wait(plant, state, acts->demanded);
    if (rest > 0) {
      of.demanded = state->demanded[plant->delay + 1];
      touched = stretch(p, &of, X, 0, rest, steps_in(plant, rest, T));
    }
    of.demanded = state->demanded[plant->delay];
  }
  touched |= stretch(p, &of, X, rest, T - rest, steps_in(plant, T - rest, T));
  amb_copy(p->states, X, state->X);
  if (!p->plain)
    rotate(&of, state, T);
  return touched;
}

static bool knows_the_law(const amb_plant *plant)
{
  return (plant->magnet[0].methods == &amb_law_magnet) &&
         ((const amb_law *)plant->magnet[0].self)->two_sided;
}

static bool is_axis(const amb_plant *plant)
{
  return plant->own && (plant->axes == 1);
}

static amb_pattern pattern_of(const amb_plant *plant)
{
  const amb_pattern p = {plant->positions, plant->axes, plant->sensors, plant->states,
                         plant->own,       false,       false};
  return p;
}

bool amb_plant_is_plain_axis(const amb_plant *plant)
{
  return is_axis(plant) && plant->plain && (plant->delay == 0) && !(plant->delay_rest > 0) &&
         knows_the_law(plant);
}

bool amb_plant_advance(const amb_plant *plant, amb_plant_state *state, amb_real T,
                       const amb_acts *acts)
{
  if (is_axis(plant) && plant->plain)
    return as_built(acts) && knows_the_law(plant) ? advance(&closed_axis, plant, state, T, acts)
                                                  : advance(&plain_axis, plant, state, T, acts);
  if (is_axis(plant) && (plant->states == axis_with_parts.states))
    return advance(&axis_with_parts, plant, state, T, acts);
  const amb_pattern any = pattern_of(plant);
  return advance(&any, plant, state, T, acts);
}

void amb_plant_rates(const amb_plant *plant, const amb_plant_state *state, const amb_acts *acts,
                     amb_real rates[])
{
  const amb_pattern p = pattern_of(plant);
  const int q = p.positions;
  amb_real X[AMB_PLANT_STATES], F[AMB_PLANT_AXES];
  amb_going of;
  bool met = false;
  prepare(&p, &of, plant, state, 1, acts);
  of.met = &met;
  amb_copy(p.states, state->X, X);
  for (int k = 0; p.own && (k < q); k++)
    X[k] = within(plant, k, X[k]);
  amb_stage(&p, &of, X, 0, F, rates);
  for (int k = 0; k < q; k++) {
    rates[k] = X[q + k];
    rates[q + k] = amb_driven(&p, &of, of.g[k] + rates[q + k], 1, F, k);
  }
}

amb_real amb_plant_from_now(const amb_plant *plant, const amb_plant_state *state, int f,
                            amb_real iu)
{
  if (plant->delay_rest > 0)
    return state->demanded[plant->delay][f];
  return plant->delay > 0 ? state->demanded[plant->delay - 1][f] : iu;
}

amb_acting amb_plant_acting(const amb_plant *plant, const amb_plant_state *state, int f,
                            const amb_acts *acts, amb_real iu)
{
  const amb_real *X = state->X;
  if (plant->plain && plant->own && as_built(acts)) {
    const amb_magnet *magnet = &plant->magnet[f];
    const amb_acting held = {.iu = iu, .force = magnet->methods->force(magnet->self, iu, X[f])};
    return held;
  }
  const amb_real s = within(plant, f, amb_plant_along(plant, f, X));
  const amb_parts *parts = &plant->amplifier[f];
  amb_real force = pull(plant, acts, f, X, iu, s);
  if (plant->couplings > 0) {
    amb_real all[AMB_PLANT_AXES], demanded[AMB_PLANT_AXES], F[AMB_PLANT_AXES];
    for (int k = 0; k < plant->axes; k++) {
      all[k] = amb_plant_along(plant, k, X);
      demanded[k] = amb_plant_from_now(plant, state, k, acts->demanded[k]);
    }
    F[f] = force;
    pull_coupled(plant, acts, X, demanded, all, F);
    force = F[f];
  }
  amb_acting acting = {.iu = current(plant, f, X, iu), .force = amb_parts_behind(parts, X, force)};
  if (parts->voltage > 0) {
    const amb_real v = velocity(plant, f, X), scale = acts->scale;
    const amb_real i = X[plant->current[f]];
    acting.voltage[0] =
        amb_parts_voltage(parts, scale, i, amb_parts_rate(parts, scale, i, iu, s, v), s, v);
    if (plant->second[f] >= 0) {
      const amb_real other = -X[plant->second[f]];
      const amb_real rate = amb_parts_rate(parts, scale, other, -iu, -s, -v);
      acting.voltage[1] = amb_parts_voltage(parts, scale, other, rate, -s, -v);
    }
  }
  return acting;
}

void amb_plant_settle(const amb_plant *plant, amb_plant_state *state, const amb_real q[],
                      const amb_real iu[])
{
  const amb_plant_state settled = {.cosine = 1};
  *state = settled;
  amb_copy(plant->positions, q, state->X);
  for (int r = 0; r < plant->sensors; r++) {
    const amb_real x = plant->own ? q[r] : amb_sparse_times(&plant->C, plant->C.value, r, q);
    state->X[plant->shows[r]] = amb_parts_shown(&plant->sensor[r], plant->gain[r], x, 1, 0);
  }
  for (int f = 0; f < plant->axes; f++) {
    if (plant->current[f] >= 0)
      state->X[plant->current[f]] = iu[f];
    if (plant->second[f] >= 0)
      state->X[plant->second[f]] = iu[f];
    const amb_parts *parts = &plant->amplifier[f];
    const amb_real s = amb_plant_along(plant, f, q);
    for (int k = 0; k < parts->behind; k++)
      state->X[parts->behind_at[k]] =
          parts->behind_rest[k] * plant->magnet[f].methods->force(plant->magnet[f].self, iu[f], s);
    for (int n = 0; n < AMB_DELAY_MOST + 2; n++)
      state->demanded[n][f] = iu[f];
  }
}
