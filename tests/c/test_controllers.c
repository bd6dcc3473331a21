/* Controllers of a machine: every term by hand, limits, and what is no number. */
#include "ambkit/controllers.h"
#include "check.h"

/* Two axes, three states, one PID of the states' mean: proportional alone. */
static const amb_pid half = {
    .T = AMB_C(1e-4), .kp = 2, .T_t = 1, .weight = 1, .iu_min = -10, .iu_max = 10};
static const amb_real position[] = {AMB_C(0.5), AMB_C(0.5), 0};
static const amb_real velocity[] = {0, 0, 1};
static const amb_real spread[] = {1, -3};
static const amb_real still[] = {1, 0, 0, 0, 0, 0};
static const amb_real quick[] = {0, 0, 0, 0, 1, 0};
static const amb_real square[] = {0, 0, 0, 0, 0, 1};
static const amb_real low[] = {-100, -100}, high[] = {100, 100};

static amb_controllers made(void)
{
  const amb_controllers all = {.axes = 2,
                               .states = 3,
                               .pids = 1,
                               .pid = &half,
                               .position = position,
                               .spread = spread,
                               .iu_min = low,
                               .iu_max = high};
  return all;
}

static void test_terms(void)
{
  const amb_real x[] = {4, 2, AMB_C(0.5)}, r[] = {5};
  amb_real iu[2];
  amb_pid_state s;
  amb_controllers c = made();
  amb_pid_reset(&s, AMB_C(0.25));
  CHECK(amb_controllers_step(&c, &s, r, x, 10, iu) == AMB_OK);
  CHECK_NEAR(iu[0], AMB_C(4.25)); /* 2 (5 - 3) and the integral */
  CHECK_NEAR(iu[1], AMB_C(-12.75));
  c.gain[0] = still;
  c.gain[1] = quick;
  c.gain[2] = square;
  CHECK(amb_controllers_step(&c, &s, r, x, 10, iu) == AMB_OK);
  CHECK_NEAR(iu[0], AMB_C(8.25));
  CHECK_NEAR(iu[1], AMB_C(-12.75) + 20 + 50);
  amb_pid slow = half;
  slow.kd = 1;
  c = made();
  c.pid = &slow;
  c.velocity = velocity;
  CHECK(amb_controllers_step(&c, &s, r, x, 3, iu) == AMB_OK);
  CHECK_NEAR(iu[0], AMB_C(4.25) - AMB_C(0.5));
}

static void test_limits_and_no_numbers(void)
{
  const amb_real x[] = {4, 2, NOT_A_NUMBER}, r[] = {5}, narrow[] = {1, 1};
  amb_real iu[2];
  amb_pid_state s;
  amb_controllers c = made();
  c.iu_max = narrow;
  c.gain[0] = square; /* sees the state that is no number: it gives nothing */
  c.position = still;
  amb_pid_reset(&s, 0);
  const amb_real good[] = {4, 2, 0};
  CHECK(amb_controllers_step(&c, &s, r, good, 1, iu) == AMB_SATURATED);
  CHECK_NEAR(iu[0], 1);
  CHECK_NEAR(iu[1], -6);
  const amb_status status = amb_controllers_step(&c, &s, r, x, 1, iu);
  CHECK((status & AMB_MISSING) != 0); /* 0 times no number is none */
  CHECK(amb_is_finite(iu[0]) && amb_is_finite(iu[1]));
}

/* Two nodes from 10 to 30 rad/s, of the third state: 4 of the first, 2 of the second; 6 and 8 A. */
static const amb_real motion[] = {0, 0, 0, 0, 4, 0, 2, 0}, current[] = {0, 0, 0, 0, 6, 0, 8, 0};
static const amb_real farther[] = {0, 0, 0, 0, 4, 0, 0, 0}, none[] = {0, 0, 0, 0};
static const amb_real small[] = {0, 0}, reach[] = {1, 0}, ampere[] = {0, AMB_C(0.25)};

static amb_unbalance_control left_to_turn(void)
{
  return (amb_unbalance_control){.nodes = 2,
                                 .from = 2,
                                 .width = 2,
                                 .moved = 2,
                                 .first = 10,
                                 .step = 20,
                                 .motion = motion,
                                 .current = current,
                                 .reach = small,
                                 .ampere = small};
}

/* The first current with so much unbalance in the third and the fourth state, at 30 rad/s. */
static amb_real first_current(const amb_unbalance_control *turn, amb_real ahead, amb_real across)
{
  const amb_real x[] = {0, 0, ahead, across}, r[] = {0};
  amb_real iu[2];
  amb_pid_state s;
  amb_controllers c = made();
  c.states = 4;
  c.position = none;
  c.unbalance_control = turn;
  amb_pid_reset(&s, 0);
  (void)amb_controllers_step(&c, &s, r, x, 30, iu);
  return iu[0];
}

static void test_what_is_left_to_turn(void)
{
  const amb_unbalance_control turn = left_to_turn();
  const amb_real x[] = {4, 2, AMB_C(0.5), 0}, r[] = {5};
  const struct {
    amb_real speed, share;
  } at[] = {{-30, 0}, {0, 0}, {10, 0}, {15, AMB_C(0.25)}, {30, 1}, {90, 1}};
  for (size_t k = 0; k < sizeof at / sizeof at[0]; k++) {
    amb_real iu[2];
    amb_pid_state s;
    amb_controllers c = made();
    c.unbalance_control = &turn;
    c.gain[0] = still;
    amb_pid_reset(&s, 0);
    CHECK(amb_controllers_step(&c, &s, r, x, at[k].speed, iu) == AMB_OK);
    const amb_real mean = 3 - at[k].share * (2 + 1) / 2, e = 2 * (5 - mean);
    CHECK_NEAR(iu[0], 4 - at[k].share * 2 + at[k].share * 3 + e);
    CHECK_NEAR(iu[1], at[k].share * 4 - 3 * e);
  }
  const amb_real lost[] = {4, 2, NOT_A_NUMBER, 0};
  amb_real iu[2];
  amb_pid_state s;
  amb_controllers c = made();
  c.unbalance_control = &turn;
  amb_pid_reset(&s, 0);
  (void)amb_controllers_step(&c, &s, r, lost, 30, iu);
  CHECK(amb_is_finite(iu[0]) && amb_is_finite(iu[1]));
}

/* All up to 0.3 of a travel or a current, nothing from 0.5 on, at any angle of the rotor. */
static void test_less_is_left_of_a_large_unbalance(void)
{
  amb_unbalance_control turn = left_to_turn();
  const amb_real all = AMB_C(0.3), between = AMB_C(0.41231056256176605), nothing = AMB_C(0.5);
  turn.motion = farther;
  turn.reach = reach; /* 1 kg m moves the first axis by 4 of its travel */
  CHECK_NEAR(first_current(&turn, all / 4, 0), 6 * all / 4);
  CHECK_NEAR(first_current(&turn, between / 4, 0), 3 * between / 4);
  CHECK_NEAR(first_current(&turn, nothing / 4, 0), 0);
  CHECK_NEAR(first_current(&turn, 1, 0), 0);
  CHECK_NEAR(first_current(&turn, AMB_C(1e30), 0), 0);
  turn.reach = small;
  turn.ampere = ampere; /* and takes 2 of the second's greatest current, a quarter turn on too */
  CHECK_NEAR(first_current(&turn, all / 2, 0), 6 * all / 2);
  CHECK_NEAR(first_current(&turn, between / 2, 0), 3 * between / 2);
  const amb_real side = between / 2 / AMB_C(1.4142135623730951);
  CHECK_NEAR(first_current(&turn, side, side), 3 * side);
  CHECK_NEAR(first_current(&turn, side, -side), 3 * side);
  CHECK_NEAR(first_current(&turn, nothing / 2, 0), 0);
}

/* Nodes at 10 and 30 rad/s: kp 2 and 4, ki and T_f as they are, kd 0 and 1. */
static void test_gains_over_the_speed(void)
{
  static const amb_real nodes[] = {10, 30}, gains[] = {2, 0, 0, 0, 4, 100, 1, 0};
  const amb_gain_schedule schedule = {2, nodes, gains};
  const amb_real x[] = {4, 2, AMB_C(0.5)}, r[] = {5};
  const struct {
    amb_real speed, share;
  } at[] = {{0, 0},  {10, 0},          {-10, 0},          {15, AMB_C(0.25)}, {-25, AMB_C(0.75)},
            {30, 1}, {AMB_C(1e30), 1}, {NOT_A_NUMBER, 0}, {-90, 1}};
  for (size_t k = 0; k < sizeof at / sizeof at[0]; k++) {
    amb_real iu[2];
    amb_pid_state s;
    amb_controllers c = made();
    c.velocity = velocity;
    c.schedule = &schedule;
    amb_pid_reset(&s, 0);
    CHECK(amb_controllers_step(&c, &s, r, x, at[k].speed, iu) == AMB_OK);
    CHECK_NEAR(iu[0], 2 * (2 + (2 * at[k].share)) - (AMB_C(0.5) * at[k].share));
    CHECK_NEAR(s.integral, AMB_C(1e-4) * 100 * at[k].share * 2);
  }
  const amb_gain_schedule always = {1, nodes, &gains[4]};
  amb_controllers c = made();
  amb_real iu[2];
  amb_pid_state s;
  c.schedule = &always;
  amb_pid_reset(&s, 0);
  CHECK(amb_controllers_step(&c, &s, r, x, 90, iu) == AMB_OK);
  CHECK_NEAR(iu[0], 8);
}

int main(void)
{
  test_gains_over_the_speed();
  test_what_is_left_to_turn();
  test_less_is_left_of_a_large_unbalance();
  test_terms();
  test_limits_and_no_numbers();
  return failures;
}
