/* Lift-off and landing: each mode, what leads from one to the next, and bits that flip. */
#include "ambkit/sequence.h"
#include "check.h"

static const amb_sequence sequence = {
    .waiting = 2, .lost = 3, .overloaded = 1, .rise = AMB_C(0.25), .descent = AMB_C(0.5)};

/* So many samples alike; the mode of the last. */
static amb_flight_mode go(amb_sequence_state *s, int samples, bool fly, bool usable, bool limited)
{
  amb_flight_mode mode = s->mode;
  for (int k = 0; k < samples; k++)
    mode = amb_sequence_step(&sequence, s, fly, usable, limited);
  return mode;
}

static void test_a_flight(void)
{
  amb_sequence_state s;
  amb_sequence_init(&s);
  CHECK(go(&s, 9, false, true, false) == AMB_OFF && !amb_sequence_on(&s));
  CHECK(go(&s, 3, true, true, false) == AMB_WAITING && !amb_sequence_on(&s));
  CHECK(go(&s, 1, true, false, false) == AMB_WAITING); /* it counts anew */
  CHECK(go(&s, 2, true, true, false) == AMB_WAITING);
  CHECK(go(&s, 1, true, true, false) == AMB_LIFTING && amb_sequence_on(&s));
  CHECK(go(&s, 3, true, true, false) == AMB_LIFTING && same(s.share, AMB_C(0.75)));
  CHECK(go(&s, 1, true, true, false) == AMB_FLYING && same(s.share, 1));
  CHECK(go(&s, 1, false, true, false) == AMB_LANDING && same(s.share, 1));
  CHECK(go(&s, 1, false, true, false) == AMB_LANDING && same(s.share, AMB_C(0.5)));
  CHECK(go(&s, 1, true, true, false) == AMB_LIFTING && same(s.share, AMB_C(0.5)));
  CHECK(go(&s, 1, false, true, false) == AMB_LANDING);
  CHECK(go(&s, 1, false, true, false) == AMB_OFF && same(s.share, 0));
  CHECK(go(&s, 1, true, true, false) == AMB_WAITING && go(&s, 1, false, true, false) == AMB_OFF);
}

static void test_what_trips_it(void)
{
  amb_sequence_state s;
  amb_sequence_levitate(&s);
  CHECK(go(&s, 3, true, false, false) == AMB_FLYING);
  CHECK(go(&s, 1, true, true, false) == AMB_FLYING);
  CHECK(go(&s, 3, true, false, false) == AMB_FLYING);
  CHECK(go(&s, 1, true, false, false) == AMB_TRIPPED && same(s.share, 0));
  CHECK(go(&s, 9, true, true, false) == AMB_TRIPPED && !amb_sequence_on(&s));
  CHECK(go(&s, 1, false, true, false) == AMB_OFF);
  amb_sequence_levitate(&s);
  CHECK(go(&s, 1, true, true, true) == AMB_FLYING && go(&s, 1, true, true, false) == AMB_FLYING);
  CHECK(go(&s, 2, true, true, true) == AMB_TRIPPED);
}

static void test_bits_that_flip(void)
{
  amb_sequence_state s;
  amb_sequence_init(&s);
  s.mode = (amb_flight_mode)77;
  CHECK(go(&s, 1, true, true, false) == AMB_TRIPPED);
  s.mode = (amb_flight_mode)77;
  s.share = AMB_C(0.25);
  CHECK(go(&s, 1, true, true, false) == AMB_LIFTING && same(s.share, AMB_C(0.5)));
  s.mode = AMB_OFF;
  CHECK(go(&s, 1, true, true, false) == AMB_LIFTING && same(s.share, AMB_C(0.75)));
  s.share = NOT_A_NUMBER;
  CHECK(go(&s, 1, true, true, false) == AMB_FLYING && same(s.share, 1));
  s.share = AMB_C(0.5);
  CHECK(go(&s, 1, true, true, false) == AMB_FLYING && same(s.share, 1));
}

int main(void)
{
  test_a_flight();
  test_what_trips_it();
  test_bits_that_flip();
  return failures;
}
