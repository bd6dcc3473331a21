/* PID: its parts one by one, its limits, and what is no number. */
#include "ambkit/controller.h"
#include "check.h"

static const amb_pid parts = {
    .T = AMB_C(1e-4),
    .kp = 3000,
    .ki = 20000,
    .kd = 12,
    .T_f = AMB_C(2e-4),
    .T_t = AMB_C(25e-3),
    .weight = 1,
    .iu_min = -2,
    .iu_max = 2,
};

static void test_parts(void)
{
  amb_pid_state s;
  amb_real iu = 0;
  amb_pid pid = parts;
  pid.ki = 0;
  amb_pid_reset(&s, AMB_C(0.25));
  CHECK(amb_pid_step(&pid, &s, AMB_C(1e-4), 0, NULL, &iu) == AMB_OK);
  CHECK_NEAR(iu, AMB_C(0.55)); /* no derivative at the first sample */
  CHECK(amb_pid_step(&pid, &s, AMB_C(1e-4), AMB_C(3e-6), NULL, &iu) == AMB_OK);
  CHECK_NEAR(s.velocity, AMB_C(0.01)); /* 3 um in 0.1 ms, a third of it through the filter */
  CHECK_NEAR(iu, AMB_C(0.25) + AMB_C(0.291) - AMB_C(0.12));
  const amb_real known = AMB_C(-0.02);
  CHECK(amb_pid_step(&pid, &s, 0, 0, &known, &iu) == AMB_OK);
  CHECK_NEAR(iu, AMB_C(0.25) + AMB_C(0.24));
  pid.ki = 20000;
  pid.kp = pid.kd = 0;
  amb_pid_reset(&s, 0);
  for (int k = 0; k < 10; k++)
    (void)amb_pid_step(&pid, &s, AMB_C(1e-4), 0, NULL, &iu);
  CHECK_NEAR(s.integral, AMB_C(2e-3));
}

static void test_setpoint_weight(void)
{
  amb_pid_state s;
  amb_real iu = 0;
  amb_pid pid = parts;
  pid.weight = AMB_C(0.25);
  pid.ki = 1000;
  amb_pid_reset(&s, 0);
  CHECK(amb_pid_step(&pid, &s, AMB_C(1e-4), AMB_C(1e-5), NULL, &iu) == AMB_OK);
  CHECK_NEAR(iu, AMB_C(0.075) - AMB_C(0.03)); /* a quarter of the reference, all of the position */
  CHECK_NEAR(s.integral, AMB_C(9e-6));        /* and to the integral all of both */
}

static void test_limits(void)
{
  amb_pid_state s;
  amb_real iu = 0;
  for (int stops = 0; stops < 2; stops++) {
    amb_pid pid = parts;
    pid.T_t = stops ? 0 : parts.T_t;
    amb_pid_reset(&s, 0);
    for (int k = 0; k < 1000; k++)
      CHECK(amb_pid_step(&pid, &s, AMB_C(0.01), 0, NULL, &iu) == AMB_SATURATED && same(iu, 2));
    CHECK(stops ? same(s.integral, 0) : s.integral < 0); /* stopped, or tracking backwards */
    CHECK(amb_pid_step(&pid, &s, AMB_C(-0.1), 0, NULL, &iu) == AMB_SATURATED && same(iu, -2));
  }
}

static void test_no_numbers(void)
{
  const amb_real bad[] = {NOT_A_NUMBER, TOO_MUCH, -TOO_MUCH};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
    amb_pid_state s;
    amb_real iu = 0, before = 0;
    amb_pid pid = parts;
    pid.ki = 0; /* so that the output shows the rest */
    amb_pid_reset(&s, AMB_C(0.1));
    (void)amb_pid_step(&pid, &s, AMB_C(1e-4), AMB_C(2e-5), NULL, &before);
    CHECK(amb_pid_step(&pid, &s, AMB_C(1e-4), bad[i], NULL, &iu) == AMB_MISSING);
    CHECK(same(iu, before));
    CHECK(amb_pid_step(&pid, &s, AMB_C(1e-4), AMB_C(2e-5), &bad[i], &iu) == AMB_MISSING);
    CHECK(same(iu, before));
    CHECK(amb_pid_step(&pid, &s, bad[i], AMB_C(2e-5), NULL, &iu) == AMB_BAD_CONTROL);
    CHECK(same(iu, before));
    CHECK(amb_pid_step(&pid, &s, bad[i], bad[i], NULL, &iu) == (AMB_MISSING | AMB_BAD_CONTROL));
    CHECK(amb_pid_step(&pid, &s, AMB_C(1e-4), AMB_C(2e-5), NULL, &iu) == AMB_OK);
    CHECK(same(iu, before));
  }
  amb_pid_state s;
  amb_real iu = 1;
  amb_pid_reset(&s, 0);
  CHECK(amb_pid_step(&parts, &s, 0, NOT_A_NUMBER, NULL, &iu) == AMB_MISSING);
  CHECK(same(iu, 0) && !s.started); /* nothing good seen yet: the demand at rest */
}

int main(void)
{
  test_parts();
  test_setpoint_weight();
  test_limits();
  test_no_numbers();
  return failures;
}
