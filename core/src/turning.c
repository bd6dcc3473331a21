#include "ambkit/model.h"

#if defined(AMB_MODEL_LOOPS)

#include "ambkit/turning.h"

/* Gain scheduling over the speed of rotation: the model between the speeds it was sampled at. */

/* Lagrange's cubics of the nodes 0, 1, 2, 3 at x. */
static void weigh(amb_real x, amb_real w[4])
{
  w[0] = ((x - AMB_C(1.0)) * (x - AMB_C(2.0)) * (AMB_C(3.0) - x)) / AMB_C(6.0);
  w[1] = (x * (x - AMB_C(2.0)) * (x - AMB_C(3.0))) / AMB_C(2.0);
  w[2] = (x * (x - AMB_C(1.0)) * (AMB_C(3.0) - x)) / AMB_C(2.0);
  w[3] = (x * (x - AMB_C(1.0)) * (x - AMB_C(2.0))) / AMB_C(6.0);
}

/* Column i of four rows, `width` apart. */
static amb_real between(const amb_real w[4], const amb_real *row, int width, int i)
{
  return (w[0] * row[i]) + (w[1] * row[width + i]) + (w[2] * row[(2 * width) + i]) +
         (w[3] * row[(3 * width) + i]);
}

bool amb_turning_takes(const amb_turning *turning, amb_real speed)
{
  const amb_real number = speed / turning->step;
  const int last = turning->lowest + turning->nodes - 1;
  return (number >= (amb_real)turning->lowest) && (number <= (amb_real)last);
}

/* The first of the four nodes around a speed of so many steps, counted from the first of all. */
static int node_before(const amb_turning *turning, amb_real number)
{
  const int most = turning->nodes - 4;
  int whole = (int)number;
  if ((amb_real)whole > number) { /* below 0 */
    whole--;
  }
  const int k = whole - 1 - turning->lowest;
  return (k < 0) ? 0 : ((k > most) ? most : k);
}

void amb_turning_to(const amb_turning *turning, amb_real speed, amb_real growth, amb_real numbers[])
{
  const int last = turning->lowest + turning->nodes - 1;
  const amb_real number =
      amb_clamp(speed / turning->step, (amb_real)turning->lowest, (amb_real)last);
  const int k = node_before(turning, number);
  const int first = turning->lowest + k;
  amb_real w[4];
  weigh(number - (amb_real)first, w);
  for (int i = 0; i < turning->changing; i++) {
    numbers[turning->which[i]] =
        between(w, &turning->at[k * turning->changing], turning->changing, i);
  }
  for (int i = 0; i < turning->growing; i++) {
    numbers[turning->grown[i]] +=
        growth * between(w, &turning->by_growth[k * turning->growing], turning->growing, i);
  }
}

void amb_turning_point(const amb_turning *turning, const amb_kalman *from, amb_kalman *kf,
                       const amb_real numbers[])
{
  const amb_real *still = turning->still;
  const amb_model *own = &from->model;
  amb_model *model = &kf->model;
  model->L.value = &numbers[own->L.value - still];
  model->b.value = &numbers[own->b.value - still];
  model->B_u.value = &numbers[own->B_u.value - still];
  model->h.value = &numbers[own->h.value - still];
  model->e = &numbers[own->e - still];
  model->r = &numbers[own->r - still];
  model->d.value = &numbers[own->d.value - still];
  model->c.value = &numbers[own->c.value - still];
  model->N.value = &numbers[own->N.value - still];
  model->rest.value = &numbers[own->rest.value - still];
}

void amb_turning_begin(const amb_turning *turning, const amb_kalman *from, amb_kalman *kf,
                       amb_real numbers[])
{
  *kf = *from;
  amb_copy(turning->numbers, turning->still, numbers);
  amb_turning_point(turning, from, kf, numbers);
}

void amb_turning_step(const amb_turning *turning, amb_kalman *kf, amb_real numbers[],
                      amb_real before, amb_real after)
{
  amb_turning_to(turning, (before + after) / AMB_C(2.0), (after - before) / kf->set.T, numbers);
  amb_model_growth(&kf->model, kf->set.var_d, kf->growth);
}

#endif
