/* The plant's parts in C alone: at rest nothing moves, a dead time, both precisions in contact, and
 * what is no number. */
#include "check.h"
#include "loop.h"
#include "plant_axis.h"

static const amb_law law = {AMB_C(6.7e-6), AMB_C(2e-3), AMB_C(1.5), true, 1, AMB_C(1e-3)};
static const amb_law coil = {AMB_C(6.7e-6), AMB_C(2e-3), AMB_C(1.5), false, 1, AMB_C(1e-3)};
static const amb_stiffness none = {0, 0};

static amb_axis_room room;

static amb_axis axis_of(const amb_parts *parts)
{
  const amb_axis axis = {
      .magnet = {&amb_law_magnet, &law},
      .m = AMB_C(0.518),
      .K_sen = 1,
      .T_sen = AMB_C(2e-4),
      .travel = AMB_C(1e-3),
      .substeps = 8,
      .parts = parts,
      .coil = {&amb_law_magnet, &coil},
  };
  return axis;
}

/* On by T with this current [A] and load [N]. */
static bool advance(const amb_axis *axis, amb_plant_state *s, amb_real T, amb_real iu, amb_real f_d)
{
  const amb_plant plant = plant_of_axis(axis, &room);
  const amb_acts acts = {.demanded = &iu, .load = &f_d, .scale = 1};
  return amb_plant_advance(&plant, s, T, &acts);
}

static void settle(const amb_axis *axis, amb_plant_state *s, amb_real x, amb_real iu)
{
  const amb_plant plant = plant_of_axis(axis, &room);
  amb_plant_settle(&plant, s, &x, &iu);
}

/* What acts just after a sample at which iu [A] is demanded; before one, with `until`. */
static amb_acting acting_at(const amb_axis *axis, const amb_plant_state *s, amb_real iu, bool until)
{
  const amb_plant plant = plant_of_axis(axis, &room);
  const amb_acts acts = {.demanded = &iu, .load = &iu, .scale = 1};
  const amb_real now =
      until ? amb_plant_until_now(&plant, s, 0, iu) : amb_plant_from_now(&plant, s, 0, iu);
  return amb_plant_acting(&plant, s, 0, &acts, now);
}

static amb_parts amplifier(void)
{
  const amb_parts parts = {
      .corner = 3000,
      .voltage = 20,
      .R = 2,
      .k = AMB_C(6.7e-6),
      .s0 = AMB_C(2e-3),
      .i0 = AMB_C(1.5),
      .pair = true,
  };
  return parts;
}

static void test_at_rest(void)
{
  const amb_parts parts = amplifier();
  const amb_axis axis = axis_of(&parts);
  amb_plant_state s;
  settle(&axis, &s, 0, 0);
  for (int k = 0; k < 100; k++)
    CHECK(!advance(&axis, &s, AMB_C(1e-4), 0, 0));
  CHECK(same(s.X[0], 0) && same(s.X[1], 0) && same(s.X[2], 0));
  const amb_acting acting = acting_at(&axis, &s, 0, true);
  CHECK(same(acting.force, 0));
  CHECK_NEAR(acting.voltage[0], AMB_C(3.0));
  CHECK_NEAR(acting.voltage[1], AMB_C(3.0));
}

static void test_voltage(void)
{
  const amb_parts parts = amplifier();
  const amb_axis axis = axis_of(&parts);
  amb_plant_state s;
  settle(&axis, &s, 0, 0);
  const amb_acting acting = acting_at(&axis, &s, AMB_C(1.5), false);
  CHECK_WITHIN(acting.voltage[0], 20, AMB_C(1e-5));
  CHECK_WITHIN(acting.voltage[1], -20, AMB_C(1e-5));
  (void)advance(&axis, &s, AMB_C(1e-5), AMB_C(1.5), 0);
  CHECK_WITHIN(s.X[3], AMB_C(17e-5) / AMB_C(6.7e-3), AMB_C(2e-3)); /* (U - R i0) T / L */
  CHECK_WITHIN(s.X[4], AMB_C(23e-5) / AMB_C(6.7e-3), AMB_C(2e-3));
}

static void test_delay(void)
{
  amb_axis axis = axis_of(NULL);
  axis.delay = 2;
  axis.delay_rest = AMB_C(5e-5);
  amb_plant_state s;
  settle(&axis, &s, 0, 0);
  for (int k = 0; k < 2; k++) {
    CHECK(same(acting_at(&axis, &s, 1, false).iu, 0));
    (void)advance(&axis, &s, AMB_C(1e-4), 1, 0);
    CHECK(same(s.X[0], 0) && same(s.X[1], 0));
  }
  (void)advance(&axis, &s, AMB_C(1e-4), 1, 0); /* half of it under 1 A */
  CHECK_WITHIN(s.X[1], AMB_C(10.05) * AMB_C(5e-5) / AMB_C(0.518), AMB_C(1e-4));
  CHECK(same(acting_at(&axis, &s, 1, true).iu, 1));
  axis.delay = AMB_DELAY_MOST; /* the longest */
  settle(&axis, &s, 0, 0);
  for (int k = 0; k < AMB_DELAY_MOST; k++)
    (void)advance(&axis, &s, AMB_C(1e-4), 1, 0);
  CHECK(same(s.X[1], 0));
  (void)advance(&axis, &s, AMB_C(1e-4), 1, 0);
  CHECK(s.X[1] > 0);
}

/* Half of the digits of the energy are kept by an elastic stop, and the damped one loses some. */
static void test_contact(void)
{
  amb_parts parts = {.stiffness = AMB_C(1e9)};
  amb_axis axis = axis_of(&parts);
  axis.farthest = AMB_C(1.9e-3);
  axis.magnet.methods = &amb_constant_magnet;
  axis.magnet.self = &none;
  for (int damped = 0; damped < 2; damped++) {
    parts.damping = damped == 1 ? AMB_C(0.5) : 0;
    amb_plant_state s;
    settle(&axis, &s, AMB_C(9.9e-4), 0);
    s.X[1] = AMB_C(0.2);
    bool touched = false;
    for (int k = 0; k < 30; k++)
      touched |= advance(&axis, &s, AMB_C(1e-4), 0, 0);
    CHECK(touched);
    CHECK_WITHIN(s.X[1], damped == 1 ? AMB_C(-0.1819) : AMB_C(-0.2), AMB_C(2e-3));
  }
}

static void test_no_number(void)
{
  amb_parts parts = amplifier();
  parts.stiffness = AMB_C(1e8);
  parts.step = AMB_C(1e-6);
  amb_axis axis = axis_of(&parts);
  axis.farthest = AMB_C(1.9e-3);
  amb_plant_state s;
  settle(&axis, &s, 0, 0);
  (void)advance(&axis, &s, AMB_C(1e-4), 0, NOT_A_NUMBER); /* it ends */
  CHECK(!amb_is_finite(amb_parts_reading(&parts, NOT_A_NUMBER, 0)));
  CHECK_NEAR(amb_parts_reading(&parts, AMB_C(1.4e-6), AMB_C(0.2e-6)), AMB_C(2e-6));
  CHECK_NEAR(amb_parts_reading(&parts, AMB_C(-1.4e-6), AMB_C(-0.2e-6)), AMB_C(-2e-6));
}

int main(void)
{
  test_at_rest();
  test_voltage();
  test_delay();
  test_contact();
  test_no_number();
  return failures;
}
