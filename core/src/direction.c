#include "ambkit/model.h"

#if defined(AMB_MODEL_LOOPS)

#include "ambkit/root.h"
#include "synchronous.h"

/* The direction of rotation by the corrections of unbalance and runout. */

/* Memory of the corrections in revolutions; and thresholds of their backward sum, relative to its
 * variance by noise and to the forward sum. */
#define TURNS AMB_C(32.0)
#define CHANCE AMB_C(12.0)
#define CLEAR AMB_C(4.0)

static amb_real square_of(const amb_real z[2])
{
  return (z[0] * z[0]) + (z[1] * z[1]);
}

void amb_direction_restart(amb_direction *direction)
{
  const amb_direction anew = {.size = {direction->size[0], direction->size[1]},
                              .held = direction->held,
                              .drift = direction->drift,
                              .mirrored = direction->mirrored,
                              .abandoned = direction->abandoned,
                              .phase = {AMB_C(1.0), AMB_C(0.0)}};
  *direction = anew;
}

/* Sum over the pairs of first order of their cosine (i = 0) or sine (1) components, each relative
 * to its initial standard deviation; with `numbers` that at the next sample. If there is unbalance,
 * runout is left out: a reading corrects both in opposite directions, and the sum may cancel. */
static amb_real sum_of(const amb_speed_error *error, const amb_model *model,
                       const amb_real numbers[], const amb_real mean[], int i)
{
  amb_real sum = AMB_C(0.0);
  for (int k = 0; k < error->pairs; k++) {
    const int at = error->pair[k].state + i;
    const bool first = !(error->pair[k].power < error->pair[0].power);
    if (first && (error->pair[k].order < AMB_C(1.5))) {
      const amb_real value =
          (numbers == NULL) ? mean[at] : amb_sparse_times(&model->L, numbers, at, mean);
      sum += value / error->std[at];
    }
  }
  return sum;
}

/* Adds the direction of the last correction of the pairs to the sums, weighted by the effect of the
 * pairs, which grows with the square of the speed for unbalance. */
static void watch(const amb_speed_error *error, const amb_model *model, const amb_real mean[],
                  amb_direction *direction)
{
  const amb_real *p = direction->phase;
  const amb_real z[2] = {sum_of(error, model, NULL, mean, 0) - direction->predicted[0],
                         sum_of(error, model, NULL, mean, 1) - direction->predicted[1]};
  const amb_real size = amb_root(square_of(z));
  if ((size > AMB_C(0.0)) &&
      (direction->passed > AMB_REVOLUTION)) { /* a pair is known after a revolution */
    const amb_real kept =
        AMB_C(1.0) - amb_at_most(direction->angle / (TURNS * AMB_REVOLUTION), AMB_C(1.0));
    const bool force = error->pair[0].power > AMB_C(0.0);
    const amb_real w = force ? (direction->angle * direction->angle) : AMB_C(1.0);
    const amb_real c[2] = {((w * z[0]) * p[0]) / size, ((w * z[1]) * p[0]) / size};
    const amb_real s[2] = {((w * z[0]) * p[1]) / size, ((w * z[1]) * p[1]) / size};
    direction->weight = (kept * direction->weight) + w;
    direction->back[0] = (kept * direction->back[0]) + (c[0] - s[1]);
    direction->back[1] = (kept * direction->back[1]) + (c[1] + s[0]);
    direction->forth[0] = (kept * direction->forth[0]) + (c[0] + s[1]);
    direction->forth[1] = (kept * direction->forth[1]) + (c[1] - s[0]);
    direction->by_chance = ((kept * kept) * direction->by_chance) + (w * w);
  }
}

/* Whether the corrections rotate backwards, more clearly than at the last reversal; if so, the
 * direction is reversed. */
static bool is_reversed(amb_direction *direction)
{
  const amb_real square = square_of(direction->back);
  const amb_real share = square / (direction->weight * direction->weight);
  const bool back = (square > (CHANCE * direction->by_chance)) &&
                    (square > (CLEAR * square_of(direction->forth))) &&
                    (share > direction->abandoned);
  if (back) {
    direction->mirrored = !direction->mirrored;
    direction->abandoned = share;
    amb_direction_restart(direction);
    direction->size[0] = AMB_C(0.0); /* estimated in the wrong direction */
    direction->size[1] = AMB_C(0.0);
  }
  return back;
}

void amb_direction_predict(const amb_speed_error *error, const amb_kalman *kf, amb_real numbers[],
                           const amb_real mean[], amb_real speed, amb_direction *direction)
{
  const int at = error->pair[0].state;
  const amb_real *L[2] = {amb_transition_entry(&kf->model, numbers, at, at),
                          amb_transition_entry(&kf->model, numbers, at + 1, at)};
  const amb_real *p = direction->phase;
  for (int i = 0; i < 2; i++) {
    direction->predicted[i] = sum_of(error, &kf->model, numbers, mean, i);
  }
  if ((L[0] != NULL) && (L[1] != NULL) && (error->pair[0].order < AMB_C(1.5))) {
    const amb_real z[2] = {(p[0] * *L[0]) - (p[1] * *L[1]), (p[0] * *L[1]) + (p[1] * *L[0])};
    const amb_real size = amb_root(square_of(z));
    direction->phase[0] = (size > AMB_C(0.0)) ? (z[0] / size) : AMB_C(1.0);
    direction->phase[1] = (size > AMB_C(0.0)) ? (z[1] / size) : AMB_C(0.0);
  }
  direction->angle = amb_magnitude(speed) * kf->set.T;
}

amb_rotation amb_directed(const amb_speed_error *error, const amb_kalman *kf,
                          const amb_kalman_state *state, amb_direction *direction,
                          const amb_rotation *rotation)
{
  amb_rotation at = *rotation;
  if (at.lost || at.afresh || !((direction->weight + direction->by_chance) >= AMB_C(0.0))) {
    direction->abandoned = AMB_C(0.0);
    amb_direction_restart(direction);
  } else if (amb_magnitude(at.now) > AMB_C(0.0)) {
    watch(error, &kf->model, state->mean, direction);
    at.afresh = is_reversed(direction);
  } else { /* the angle is not known well enough */
  }
  if (direction->mirrored) {
    at.speed = -at.speed;
    at.acceleration = -at.acceleration;
    at.now = -at.now;
    at.estimate = -at.estimate;
  }
  return at;
}

amb_status amb_direction_status(const amb_direction *direction, amb_real speed)
{
  return (direction->mirrored && (amb_magnitude(speed) > AMB_C(0.0))) ? AMB_MIRRORED : AMB_OK;
}

#endif
