/* Loops over a model that is not the paper's: several sensors, magnets and amplifiers, currents
 * that are states, a control that acts on them, an empty row; each kind of the family on it, one
 * sensor at fault; and a model of the largest size there is room for. Only where loops are built.
 */
#include "family.h"

/* Two carriages of 1 kg on two magnets each with an amplifier's lag: x1 v1 x2 v2 f_d i1 i2. */
enum { N = 7, FORCES = 2, CONTROLS = 2, SENSORS = 3, ENTRIES = N * (N + 1) / 2 };

#define SAMPLE AMB_C(1e-4)
#define LAG AMB_C(0.7) /* of a current, what is left of it after a sample */

static const unsigned short L_start[] = {0, 2, 3, 5, 6, 7, 8, 9};
static const unsigned short L_column[] = {0, 1, 1, 2, 3, 3, 4, 5, 6};
static const amb_real L_value[] = {1, SAMPLE, 1, 1, SAMPLE, 1, 1, LAG, LAG};
static const unsigned short b_start[] = {0, 1, 2, 3, 4, 4, 4, 4}, b_column[] = {0, 0, 1, 1};
static const amb_real b_value[] = {SAMPLE * SAMPLE / 2, SAMPLE, SAMPLE * SAMPLE / 2, SAMPLE};
static const unsigned short u_start[] = {0, 0, 0, 0, 0, 0, 1, 2}, u_column[] = {0, 1};
static const amb_real u_value[] = {1 - LAG, 1 - LAG};
/* Each magnet at its carriage, which it pulls with its current; the load pulls with the first. */
static const unsigned short h_start[] = {0, 4, 7}, h_column[] = {0, 1, 4, 5, 2, 3, 6};
static const amb_real h_value[] = {1, SAMPLE / 2, 0, 0, 1, SAMPLE / 2, 0};
static const amb_real e_value[] = {0, 0, 0, AMB_C(0.8), 0, 0, AMB_C(0.8)};
static const amb_real r_value[] = {0, 0, 1, 0, 0, 0, 0};
static const unsigned short d_start[] = {0, 1, 2}, d_column[] = {0, 1};
static const amb_real d_value[] = {AMB_C(0.2), AMB_C(0.2)};
/* One sensor at each carriage, and one between them. */
static const unsigned short c_start[] = {0, 1, 2, 4}, c_column[] = {0, 2, 0, 2};
static const amb_real c_value[] = {1, 1, AMB_C(0.5), AMB_C(0.5)};
static const unsigned short N_start[] = {0, 1, 2}, N_column[] = {22, 13}; /* f_d, x2 */
static const amb_real N_value[] = {1, 1};
static const unsigned short rest_start[N + 1] = {0};
static const unsigned char role[] = {AMB_POSITION, AMB_VELOCITY, AMB_POSITION, AMB_VELOCITY,
                                     AMB_LOAD,     AMB_KNOWN,    AMB_KNOWN};
static const amb_model model = {
    .states = N,
    .forces = FORCES,
    .controls = CONTROLS,
    .sensors = SENSORS,
    .noises = 2,
    .L = {L_start, L_column, L_value},
    .b = {b_start, b_column, b_value},
    .B_u = {u_start, u_column, u_value},
    .h = {h_start, h_column, h_value},
    .e = e_value,
    .r = r_value,
    .d = {d_start, d_column, d_value},
    .c = {c_start, c_column, c_value},
    .N = {N_start, N_column, N_value},
    .rest = {rest_start, L_column, L_value},
    .role = role,
};
static const amb_kalman_settings settings = {
    .T = SAMPLE,
    .K_sen = {1, 1, 1},
    .travel = {AMB_C(1e-3), AMB_C(1e-3), AMB_C(1e-3)},
    .k_ui = {1, AMB_C(1.25)},
    .iu_min = {AMB_C(-1.5), AMB_C(-1.5)},
    .iu_max = {AMB_C(1.5), AMB_C(1.5)},
    .f_0 = {-5, -4},
    .x_max = {AMB_C(1e-3), AMB_C(1e-3)},
    .cap = {AMB_C(1e-3), 1, AMB_C(1e-3), 1, AMB_C(1e4), AMB_C(1.5), AMB_C(1.5)},
    .var_u = {AMB_C(1e-5), AMB_C(1e-5)},
    .var_d = {AMB_C(1e-2), AMB_C(1e-16)},
    .var_y = {AMB_C(1e-10), AMB_C(1e-10), AMB_C(1e-10)},
    .gate = 8,
    .frozen_limit = 10,
    .outlier_limit = 3,
};
static const amb_magnet two[AMB_FORCES] = {{&amb_law_magnet, &law},
                                           {&amb_constant_magnet, &centre}};
static const amb_real std[AMB_STATES] = {AMB_C(3e-5), AMB_C(1e-2), AMB_C(3e-5), AMB_C(1e-2),
                                         5,           AMB_C(0.1),  AMB_C(0.1)};

static amb_kalman filter(void)
{
  amb_kalman kf;
  CHECK(amb_kalman_init(&kf, &model, &settings) == AMB_OK);
  return kf;
}

static bool sound(const amb_kalman_state *s)
{
  bool good = all_finite(s->mean, N) && all_finite(s->cov, ENTRIES);
  for (int i = 0; i < N; i++)
    good = good && (s->cov[amb_entry(N, i, i)] >= 0);
  return good;
}

static void test_roles(void)
{
  CHECK(amb_first(&model, AMB_POSITION) == 0 && amb_first(&model, AMB_VELOCITY) == 1);
  CHECK(amb_first(&model, AMB_LOAD) == 4 && amb_first(&model, AMB_KNOWN) == 5);
  CHECK(amb_model_role(&model, 6) == AMB_KNOWN);
}

/* Each setting of each sensor, amplifier, magnet and state is looked at, the last ones too. */
static void test_settings(void)
{
  amb_kalman kf;
  amb_kalman_settings s = settings;
  amb_real *const positive[] = {&s.travel[2], &s.var_y[2], &s.x_max[1], &s.cap[6]};
  amb_real *const number[] = {&s.K_sen[2], &s.lag[2],   &s.k_ui[1], &s.iu_max[1],
                              &s.f_0[1],   &s.var_u[1], &s.var_d[1]};
  for (size_t i = 0; i < sizeof positive / sizeof *positive; i++) {
    s = settings;
    *positive[i] = 0;
    CHECK(amb_kalman_init(&kf, &model, &s) == AMB_BAD_PARAMETER);
  }
  for (size_t i = 0; i < sizeof number / sizeof *number; i++) {
    s = settings;
    *number[i] = NOT_A_NUMBER;
    CHECK(amb_kalman_init(&kf, &model, &s) == AMB_BAD_PARAMETER);
  }
}

static void test_one_sample(void)
{
  amb_real mean[AMB_STATES] = {AMB_C(1e-4), AMB_C(0.01), AMB_C(-2e-4), AMB_C(0.02), 3, 1, -1};
  const amb_real iu[AMB_CONTROLS] = {AMB_C(0.5), AMB_C(-0.25)}, F[AMB_FORCES] = {7, -2};
  CHECK_NEAR(amb_model_current(&model, 1, mean, iu), AMB_C(-0.85));
  CHECK_NEAR(amb_model_displacement(&model, 0, mean), AMB_C(1.005e-4));
  amb_model_predict_mean(&model, F, iu, mean);
  CHECK_NEAR(mean[1], AMB_C(0.011));  /* 7 N and the load's 3 N */
  CHECK_NEAR(mean[3], AMB_C(0.0198)); /* -2 N */
  CHECK_NEAR(mean[5], LAG + (1 - LAG) * AMB_C(0.5));
  CHECK_NEAR(mean[6], -LAG + (1 - LAG) * AMB_C(-0.25));
  CHECK(same(mean[4], 3));
  amb_real moved[AMB_STATES], growth[AMB_TRIANGLE];
  amb_model_pushed(&model, 1, moved);
  CHECK(same(moved[3], SAMPLE) && same(moved[1], 0) && same(moved[6], 0));
  amb_model_growth(&model, settings.var_d, growth);
  CHECK(same(growth[22], settings.var_d[0]) && same(growth[13], settings.var_d[1]));
  CHECK(same(growth[0], 0) && same(growth[ENTRIES - 1], 0));
}

/* Of a sensor between two carriages. */
static void test_shown(void)
{
  amb_real mean[AMB_STATES] = {AMB_C(1e-4), 0, AMB_C(3e-4)}, with[AMB_STATES];
  amb_real cov[AMB_TRIANGLE] = {0}, e;
  cov[amb_entry(N, 0, 0)] = 4;
  cov[amb_entry(N, 2, 2)] = 2;
  cov[amb_entry(N, 0, 2)] = 1;
  cov[amb_entry(N, 4, 4)] = 1;
  CHECK_NEAR(amb_model_shown(&model, 2, mean), AMB_C(2e-4));
  CHECK_NEAR(amb_model_shown_variance(&model, 2, cov), 2);
  amb_model_shown_with(&model, 2, cov, with);
  CHECK(same(with[0], AMB_C(2.5)) && same(with[2], AMB_C(1.5)) && same(with[4], 0));
  amb_model_update(&model, 2, 8, 5, mean, cov, &e);
  CHECK_NEAR(mean[0], AMB_C(1e-4) + AMB_C(0.5) * e);
  CHECK_NEAR(cov[amb_entry(N, 0, 0)], AMB_C(2.75));
  CHECK_NEAR(cov[amb_entry(N, 0, 2)], AMB_C(0.25));
  CHECK(same(cov[amb_entry(N, 4, 4)], 1));
}

static void measure(int k, amb_real y[AMB_SENSORS])
{
  y[0] = axis_wobble(k);
  y[1] = axis_wobble(k + 2);
  y[2] = axis_wobble(k + 5);
}

static const amb_real acted[AMB_CONTROLS] = {AMB_C(0.4976), AMB_C(0.318408)};

/* What one sensor does is its own matter: the others are taken in, and say how they are. */
static void test_one_sensor_at_fault(const amb_estimator_methods *methods, const void *own)
{
  const amb_kalman kf = filter();
  const amb_estimator e = {methods, &kf, two, own};
  family_state s;
  amb_kalman_result r;
  CHECK(methods->reset(&e, &s, at_rest, std) == AMB_OK);
  for (int k = 0; k < 3000; k++) {
    amb_real y[AMB_SENSORS] = {0};
    amb_status told = AMB_OK;
    measure(k, y);
    if (k >= 500 && k < 1500) {
      y[0] = NOT_A_NUMBER;
      told = AMB_MISSING;
    } else if (k >= 1800 && k < 1900) {
      y[0] = AMB_C(2e-6);
      told = (k >= 1810) ? AMB_FROZEN : AMB_OK;
    } else if (k == 2200 || k == 2201) {
      y[0] = AMB_C(9e-4);
      told = AMB_OUTLIER;
    }
    const amb_status all = amb_estimator_step(&e, &s, y, acted, &r);
    CHECK(sound(&s.base));
    if (k > 100) {
      CHECK((r.health[0] & AMB_UNUSED) == told && (all & told) == told);
      CHECK(((r.health[1] | r.health[2]) & (AMB_UNUSED | AMB_RESTARTED)) == AMB_OK);
      CHECK((all & (AMB_HELD | AMB_RESTARTED | AMB_BAD_VARIANCE)) == AMB_OK);
      CHECK((told == AMB_OK) == (amb_magnitude(r.innovation[0]) > 0) || (told & AMB_OUTLIER) != 0U);
    }
    if (failures > 0)
      return;
  }
  CHECK(amb_magnitude(s.base.mean[0]) < AMB_C(1e-4));
  CHECK(amb_magnitude(s.base.mean[2]) < AMB_C(1e-4));
}

/* Any faults at each sensor and amplifier, each on its own; then the rotor is found again. */
static void test_all_at_fault(const amb_estimator_methods *methods, const void *own)
{
  const amb_kalman kf = filter();
  const amb_estimator e = {methods, &kf, two, own};
  unsigned long of[SENSORS + CONTROLS];
  amb_real stuck[SENSORS + CONTROLS] = {AMB_C(1e-3), 0, 0, 0, 0};
  family_state s;
  amb_kalman_result r;
  amb_status last = AMB_OK;
  CHECK(methods->reset(&e, &s, at_rest, NULL) == AMB_OK);
  for (int k = 0; k < 60000; k++) {
    const bool good = k % 6000 >= 4000;
    amb_real y[AMB_SENSORS] = {0}, u[AMB_CONTROLS] = {acted[0], acted[1]};
    for (int i = 0; (k % 499 == 0) && (i < SENSORS + CONTROLS); i++)
      of[i] = family_draw() % 12UL;
    measure(k, y);
    for (int i = 0; !good && (i < SENSORS); i++)
      y[i] = family_faulty(of[i], k, y[i], &stuck[i]);
    for (int i = 0; !good && (i < CONTROLS); i++)
      u[i] = family_faulty(of[SENSORS + i], k, u[i], &stuck[SENSORS + i]);
    last = amb_estimator_step(&e, &s, y, u, &r);
    CHECK(sound(&s.base) && all_finite(r.innovation, SENSORS) && all_finite(r.variance, SENSORS));
    if (k % 6000 == 5999) {
      CHECK((last & (AMB_HELD | AMB_RESTARTED | AMB_UNUSED)) == AMB_OK);
      CHECK(amb_magnitude(s.base.mean[0]) < AMB_C(1e-4));
      CHECK(amb_magnitude(s.base.mean[2]) < AMB_C(1e-4));
    }
    if (failures > 0)
      return;
  }
}

/* As many of everything as there is room for, and all of them coupled. */
static void test_the_most(void)
{
  enum { MOST = AMB_STATES * AMB_STATES };
  static unsigned short start[AMB_STATES + 1], column[MOST], start_b[AMB_STATES + 1],
      column_b[MOST], start_h[AMB_FORCES + 1], start_d[AMB_FORCES + 1], column_d[MOST],
      start_N[AMB_NOISES + 1], column_N[AMB_NOISES];
  static amb_real small[MOST], unity[MOST];
  static unsigned char roles[AMB_STATES];
  for (int i = 0; i <= AMB_STATES; i++) {
    start[i] = (unsigned short)(i * AMB_STATES);
    start_b[i] = (unsigned short)(i * AMB_FORCES);
  }
  for (int i = 0; i <= AMB_FORCES; i++) { /* as many sensors and controls as forces */
    start_h[i] = (unsigned short)(i * AMB_STATES);
    start_d[i] = (unsigned short)(i * AMB_CONTROLS);
  }
  for (int i = 0; i < MOST; i++) {
    column[i] = (unsigned short)(i % AMB_STATES);
    column_b[i] = (unsigned short)(i % AMB_FORCES);
    column_d[i] = (unsigned short)(i % AMB_CONTROLS);
    small[i] = (i / AMB_STATES == i % AMB_STATES) ? AMB_C(0.5) : AMB_C(0.001) * (amb_real)(i % 3);
    unity[i] = AMB_C(0.01) * (amb_real)(1 + i % 5);
  }
  for (int i = 0; i < AMB_NOISES; i++)
    column_N[i] = (unsigned short)amb_entry(AMB_STATES, 2 * i + 1, 2 * i + 1);
  for (int i = 0; i <= AMB_NOISES; i++)
    start_N[i] = (unsigned short)i;
  for (int i = 0; i < AMB_STATES; i++)
    roles[i] = (unsigned char)(i % 5);
  const amb_sparse in = {start_b, column_b, unity}, forms = {start_h, column, small};
  const amb_model most = {AMB_STATES,
                          AMB_FORCES,
                          AMB_CONTROLS,
                          AMB_SENSORS,
                          AMB_NOISES,
                          {start, column, small},
                          in,
                          in,
                          forms,
                          small,
                          small,
                          {start_d, column_d, unity},
                          forms,
                          {start_N, column_N, unity},
                          {start, column, small},
                          roles};
  static amb_kalman_settings set;
  set = settings;
  for (int i = 0; i < AMB_STATES; i++)
    set.cap[i] = 1;
  for (int i = 0; i < AMB_NOISES; i++)
    set.var_d[i] = AMB_C(1e-6);
  for (int i = 0; i < AMB_FORCES; i++) {
    set.x_max[i] = set.travel[i] = set.K_sen[i] = set.k_ui[i] = set.iu_max[i] = 1;
    set.var_u[i] = set.var_y[i] = AMB_C(1e-4);
    set.iu_min[i] = -1;
  }
  static amb_kalman kf;
  static family_state s;
  static amb_observer observer;
  static amb_kalman_result r;
  amb_magnet magnets[AMB_FORCES];
  const amb_stiffness k = {AMB_C(0.1), AMB_C(0.1)};
  amb_real wide[AMB_STATES], u[AMB_CONTROLS], y[AMB_SENSORS];
  for (int i = 0; i < AMB_FORCES; i++) {
    const amb_magnet constant = {&amb_constant_magnet, &k};
    magnets[i] = constant;
  }
  for (int i = 0; i < AMB_STATES; i++) {
    wide[i] = AMB_C(0.1);
    observer.far[i] = 10;
  }
  for (int i = 0; i < AMB_SENSORS; i++)
    observer.variance[i] = 1;
  CHECK(amb_kalman_init(&kf, &most, &set) == AMB_OK);
  for (int kind = 0; kind < FAMILY_KINDS; kind++) {
    amb_estimator e = {family_kinds[kind].methods, &kf, magnets, family_kinds[kind].own};
    if (e.methods == &amb_observer_methods)
      e.own = &observer;
    if (e.methods == &amb_low_pass_methods) /* of one force and one sensor */
      continue;
    CHECK(e.methods->reset(&e, &s, at_rest, wide) == AMB_OK);
    for (int at = 0; at < 20; at++) {
      for (int i = 0; i < AMB_FORCES; i++) {
        u[i] = AMB_C(0.1) * (amb_real)((at + i) % 3 - 1);
        y[i] = AMB_C(0.01) * (amb_real)((at + 2 * i) % 5 - 2);
      }
      (void)amb_estimator_step(&e, &s, y, u, &r);
      CHECK(all_finite(s.base.mean, AMB_STATES) && all_finite(s.base.cov, AMB_TRIANGLE));
      CHECK(all_finite(r.innovation, AMB_SENSORS) && r.stiffness[AMB_FORCES - 1].k_s > 0);
    }
  }
}

int main(void)
{
  test_roles();
  test_settings();
  test_one_sample();
  test_shown();
  for (int kind = 0; kind < FAMILY_KINDS; kind++) {
    if (!family_kinds[kind].certain) /* an axis' own */
      continue;
    test_one_sensor_at_fault(family_kinds[kind].methods, family_kinds[kind].own);
    test_all_at_fault(family_kinds[kind].methods, family_kinds[kind].own);
    if (failures > 0) {
      (void)fprintf(stderr, "kind %d\n", kind);
      return failures;
    }
  }
  test_the_most();
  return failures;
}
