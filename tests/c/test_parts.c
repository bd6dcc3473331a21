/* The plant's parts in C alone: at rest nothing moves, a dead time, both precisions in contact, and
 * what is no number. */
#include "check.h"
#include "loop.h"

static const amb_law law = {AMB_C(6.7e-6), AMB_C(2e-3), AMB_C(1.5), true, 1, AMB_C(1e-3)};
static const amb_law coil = {AMB_C(6.7e-6), AMB_C(2e-3), AMB_C(1.5), false, 1, AMB_C(1e-3)};
static const amb_stiffness none = {0, 0};

static amb_plant plant_of(const amb_parts *parts)
{
  const amb_plant plant = {
      .magnet = {&amb_law_magnet, &law},
      .m = AMB_C(0.518),
      .K_sen = 1,
      .T_sen = AMB_C(2e-4),
      .travel = AMB_C(1e-3),
      .substeps = 8,
      .parts = parts,
      .coil = {&amb_law_magnet, &coil},
  };
  return plant;
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
  const amb_plant plant = plant_of(&parts);
  amb_plant_state s;
  amb_plant_settle(&plant, &s, 0, 0);
  for (int k = 0; k < 100; k++)
    CHECK(!amb_plant_advance(&plant, &s, AMB_C(1e-4), 0, 0));
  CHECK(same(s.x, 0) && same(s.v, 0) && same(s.x_m, 0));
  const amb_acting acting = amb_plant_until_now(&plant, &s, 0);
  CHECK(same(acting.force, 0));
  CHECK_NEAR(acting.voltage[0], AMB_C(3.0));
  CHECK_NEAR(acting.voltage[1], AMB_C(3.0));
}

static void test_voltage(void)
{
  const amb_parts parts = amplifier();
  const amb_plant plant = plant_of(&parts);
  amb_plant_state s;
  amb_plant_settle(&plant, &s, 0, 0);
  const amb_acting acting = amb_plant_from_now(&plant, &s, AMB_C(1.5));
  CHECK_WITHIN(acting.voltage[0], 20, AMB_C(1e-5));
  CHECK_WITHIN(acting.voltage[1], -20, AMB_C(1e-5));
  (void)amb_plant_advance(&plant, &s, AMB_C(1e-5), AMB_C(1.5), 0);
  CHECK_WITHIN(s.i[0], AMB_C(17e-5) / AMB_C(6.7e-3), AMB_C(2e-3)); /* (U - R i0) T / L */
  CHECK_WITHIN(s.i[1], AMB_C(23e-5) / AMB_C(6.7e-3), AMB_C(2e-3));
}

static void test_delay(void)
{
  amb_parts parts = {.delay = 2, .delay_rest = AMB_C(5e-5)};
  const amb_plant plant = plant_of(&parts);
  amb_plant_state s;
  amb_plant_settle(&plant, &s, 0, 0);
  for (int k = 0; k < 2; k++) {
    CHECK(same(amb_plant_from_now(&plant, &s, 1).iu, 0));
    (void)amb_plant_advance(&plant, &s, AMB_C(1e-4), 1, 0);
    CHECK(same(s.x, 0) && same(s.v, 0));
  }
  (void)amb_plant_advance(&plant, &s, AMB_C(1e-4), 1, 0); /* half of it under 1 A */
  CHECK_WITHIN(s.v, AMB_C(10.05) * AMB_C(5e-5) / AMB_C(0.518), AMB_C(1e-4));
  CHECK(same(amb_plant_until_now(&plant, &s, 1).iu, 1));
  parts.delay = AMB_DELAY_MOST; /* the longest */
  amb_plant_settle(&plant, &s, 0, 0);
  for (int k = 0; k < AMB_DELAY_MOST; k++)
    (void)amb_plant_advance(&plant, &s, AMB_C(1e-4), 1, 0);
  CHECK(same(s.v, 0));
  (void)amb_plant_advance(&plant, &s, AMB_C(1e-4), 1, 0);
  CHECK(s.v > 0);
}

/* Half of the digits of the energy are kept by an elastic stop, and the damped one loses some. */
static void test_contact(void)
{
  amb_parts parts = {.stiffness = AMB_C(1e9), .farthest = AMB_C(1.9e-3)};
  amb_plant plant = plant_of(&parts);
  plant.magnet.methods = &amb_constant_magnet;
  plant.magnet.self = &none;
  for (int damped = 0; damped < 2; damped++) {
    parts.damping = damped == 1 ? AMB_C(0.5) : 0;
    amb_plant_state s;
    amb_plant_settle(&plant, &s, AMB_C(9.9e-4), 0);
    s.v = AMB_C(0.2);
    bool touched = false;
    for (int k = 0; k < 30; k++)
      touched |= amb_plant_advance(&plant, &s, AMB_C(1e-4), 0, 0);
    CHECK(touched);
    CHECK_WITHIN(s.v, damped == 1 ? AMB_C(-0.1819) : AMB_C(-0.2), AMB_C(2e-3));
  }
}

static void test_no_number(void)
{
  amb_parts parts = amplifier();
  parts.stiffness = AMB_C(1e8);
  parts.farthest = AMB_C(1.9e-3);
  parts.step = AMB_C(1e-6);
  const amb_plant plant = plant_of(&parts);
  amb_plant_state s;
  amb_plant_settle(&plant, &s, 0, 0);
  (void)amb_plant_advance(&plant, &s, AMB_C(1e-4), 0, NOT_A_NUMBER); /* it ends */
  CHECK(!amb_is_finite(amb_plant_measure(&plant, NOT_A_NUMBER, 0)));
  CHECK_NEAR(amb_plant_measure(&plant, AMB_C(1.4e-6), AMB_C(0.2e-6)), AMB_C(2e-6));
  CHECK_NEAR(amb_plant_measure(&plant, AMB_C(-1.4e-6), AMB_C(-0.2e-6)), AMB_C(-2e-6));
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
