#include "ambkit/rebuild.h"

static int slots_of(const amb_rebuild *of)
{
  return of->parameters + of->constants + of->operations;
}

int amb_rebuild_room(const amb_rebuild *of)
{
  const amb_plan *plan = &of->plan;
  const int n = plan->states;
  const int size = AMB_PLAN_SIZE(plan);
  return (3 * size * size) + AMB_SAMPLING_WORK(size) + (plan->noises * n * (n + 1)) + slots_of(of) +
         plan->terms + plan->forces;
}

static bool within_limits(const amb_rebuild *of, const double parameters[])
{
  bool within = true;
  for (int i = 0; i < of->parameters; i++) {
    within = within && (parameters[i] >= of->low[i]) && (parameters[i] <= of->high[i]);
  }
  return within;
}

static double result_of(amb_operation operation, double left, double right)
{
  double result = left;
  switch (operation) {
  case AMB_ADD:
    result += right;
    break;
  case AMB_SUBTRACT:
    result -= right;
    break;
  case AMB_MULTIPLY:
    result *= right;
    break;
  default:
    result /= right;
    break;
  }
  return result;
}

static void evaluate(const amb_rebuild *of, const double parameters[], double slot[])
{
  for (int i = 0; i < of->parameters; i++) {
    slot[i] = parameters[i];
  }
  for (int i = 0; i < of->constants; i++) {
    slot[of->parameters + i] = of->constant[i];
  }
  const int first = of->parameters + of->constants;
  for (int i = 0; i < of->operations; i++) {
    slot[first + i] =
        result_of((amb_operation)of->operation[i], slot[of->left[i]], slot[of->right[i]]);
  }
}

static void gather(int count, const unsigned short from[], const double slot[], double to[])
{
  for (int i = 0; i < count; i++) {
    to[i] = slot[from[i]];
  }
}

bool amb_rebuild_numbers(const amb_rebuild *of, const double parameters[], amb_real numbers[],
                         double room[])
{
  if (!within_limits(of, parameters)) {
    return false;
  }
  amb_plan plan = of->plan;
  const int n = plan.states;
  const int size = AMB_PLAN_SIZE(&plan);
  double *N = &room[size * size];
  double *slot = &N[plan.noises * n * n];
  double *value = &slot[slots_of(of)];
  double *k_i = &value[plan.terms];
  double *intensity = &k_i[plan.forces];
  evaluate(of, parameters, slot);
  gather(plan.terms, of->value, slot, value);
  gather(plan.forces, of->k_i, slot, k_i);
  gather(plan.noises * n, of->intensity, slot, intensity);
  plan.value = value;
  plan.k_i = k_i;
  plan.intensity = intensity;
  if (!amb_plan_sampled(&plan, room, N, &intensity[plan.noises * n])) {
    return false;
  }
  bool finite = true;
  for (int i = 0; i < of->numbers; i++) {
    const double number = room[of->from[i]];
    finite = finite && (number >= -(double)AMB_REAL_MAX) && (number <= (double)AMB_REAL_MAX);
  }
  for (int i = 0; (i < of->numbers) && finite; i++) {
    numbers[i] = (amb_real)room[of->from[i]];
  }
  return finite;
}
