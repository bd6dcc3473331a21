/* Prints, to the last bit, what each kind of the family makes of the same record with faults; the
 * same program in the build with the axis built in and in that with loops (tests/test_loops.py). */
#include "ambkit/estimator_run.h"
#include "ambkit/smoother.h"
#include "family.h"

#define STEPS 18000
#define RECORD 1500

static amb_real measured(int k)
{
  const int of = k % 3000;
  if (of >= 1000 && of < 1400)
    return NOT_A_NUMBER;
  if (of >= 1800 && of < 1820)
    return AMB_C(2e-6); /* frozen */
  if (of >= 2100 && of < 2103)
    return AMB_C(9e-4);
  if (of >= 2300 && of < 2320)
    return AMB_C(7e-4) + axis_wobble(k); /* so long that the filter starts afresh there */
  return AMB_C(3e-5) * (amb_real)(of % 400 < 200 ? 1 : -1) + axis_wobble(k);
}

static amb_real acted(int k)
{
  const int of = k % 3000;
  if (of >= 1500 && of < 1510)
    return (k % 2 == 0) ? NOT_A_NUMBER : -TOO_MUCH;
  if (of >= 2600 && of < 2640)
    return 9;
  return family_control(k) + AMB_C(0.2) * (amb_real)(of % 400 < 200 ? 1 : -1);
}

static void print(const char *what, const amb_real *numbers, int n)
{
  (void)printf("  %s", what);
  for (int i = 0; i < n; i++)
    (void)printf(" %a", (double)numbers[i]);
  (void)printf("\n");
}

static void print_kind(int kind, const amb_magnet *magnet, axis_form form)
{
  const amb_kalman_settings settings = family_settings();
  const amb_model model = axis_model(PAPER_T, PAPER_M, 1, PAPER_T_SEN, form);
  amb_kalman kf;
  amb_augmented augmented = family_augmented;
  amb_multiple_model models = family_models;
  amb_estimator e = {family_kinds[kind].methods, &kf, magnet, family_kinds[kind].own};
  augmented.learn.least = models.learn.least = 0; /* learn, whatever it is worth */
  if (e.methods == &amb_augmented_methods)
    e.own = &augmented;
  if (e.methods == &amb_multiple_model_methods)
    e.own = &models;
  family_state s;
  amb_kalman_result r;
  amb_status all = AMB_OK;
  if ((amb_kalman_init(&kf, &model, &settings) != AMB_OK) ||
      (e.methods->reset(&e, &s, at_rest, some) != AMB_OK))
    return;
  (void)printf("kind %d\n", kind);
  (void)axis_start(&e, &s, measured(0), &r);
  for (int k = 1; k < STEPS; k++) {
    all |= axis_step(&e, &s, measured(k), acted(k), &r);
    if (k % 250 == 0 || k == STEPS - 1) {
      (void)printf(" step %d status %u of all %u\n", k, r.status, all);
      print("mean", s.base.mean, AXIS_STATES);
      print("cov", s.base.cov, AXIS_ENTRIES);
      print("innovation", r.innovation, 1);
      print("variance", r.variance, 1);
    }
  }
  if (e.methods->scale != NULL) {
    amb_real scale[2];
    e.methods->scale(&e, &s, &scale[0], &scale[1]);
    print("scale", scale, 2);
  }
}

static void print_smoothed(void)
{
  static amb_real y[RECORD], u[RECORD], mean[AXIS_STATES * RECORD], cov[AXIS_ENTRIES * RECORD];
  static amb_real innovation[RECORD], variance[RECORD], k_i[RECORD], k_s[RECORD];
  static unsigned short status[RECORD];
  const amb_kalman_history h = {mean, cov,  innovation, variance, k_i,
                                k_s,  NULL, NULL,       status,   status};
  const amb_kalman_input in = {RECORD, y, u, NULL, NULL};
  const amb_kalman kf = family_filter();
  const amb_magnet magnets[AMB_FORCES] = {closed};
  amb_kalman_state s;
  (void)amb_kalman_reset(&kf, &s, at_rest, some);
  for (int k = 0; k < RECORD; k++) {
    y[k] = measured(k);
    u[k] = acted(k);
  }
  (void)printf("record %u\n", amb_kalman_run(&kf, magnets, &s, &in, &h));
  print("mean", mean, AXIS_STATES * RECORD);
  print("cov", cov, AXIS_ENTRIES * RECORD);
  amb_smooth(&kf, RECORD, &h);
  print("smoothed mean", mean, AXIS_STATES * RECORD);
  print("smoothed cov", cov, AXIS_ENTRIES * RECORD);
}

int main(void)
{
  for (int kind = 0; kind < FAMILY_KINDS; kind++) {
    print_kind(kind, &closed, AXIS_EXACT);
    print_kind(kind, &linear, AXIS_AS_PRINTED);
  }
  print_smoothed();
  return failures;
}
