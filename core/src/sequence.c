#include "ambkit/sequence.h"

void amb_sequence_init(amb_sequence_state *state)
{
  state->mode = AMB_OFF;
  state->usable = 0U;
  state->unusable = 0U;
  state->limited = 0U;
  state->share = AMB_C(0.0);
}

void amb_sequence_levitate(amb_sequence_state *state)
{
  amb_sequence_init(state);
  state->mode = AMB_FLYING;
  state->share = AMB_C(1.0);
}

bool amb_sequence_on(const amb_sequence_state *state)
{
  return (state->mode == AMB_LIFTING) || (state->mode == AMB_FLYING) ||
         (state->mode == AMB_LANDING);
}

void amb_sequence_trip(amb_sequence_state *state)
{
  if (state->mode != AMB_OFF) {
    state->mode = AMB_TRIPPED;
    state->share = AMB_C(0.0);
  }
}

/* Counter of consecutive samples, limited to `limit` + 1. */
static unsigned int counted(unsigned int in_a_row, bool one_more, unsigned int limit)
{
  unsigned int count = in_a_row;
  if (!one_more) {
    count = 0U;
  } else if (in_a_row <= limit) {
    count = in_a_row + 1U;
  } else { /* limited */
  }
  return count;
}

static void rise(const amb_sequence *sequence, amb_sequence_state *state)
{
  state->share += sequence->rise;
  if (state->share >= AMB_C(1.0)) {
    state->share = AMB_C(1.0);
    state->mode = AMB_FLYING;
  }
}

static void sink(const amb_sequence *sequence, amb_sequence_state *state)
{
  state->share -= sequence->descent;
  if (state->share <= AMB_C(0.0)) {
    amb_sequence_init(state);
  }
}

static void wait(const amb_sequence *sequence, amb_sequence_state *state, bool usable)
{
  state->usable = counted(state->usable, usable, sequence->waiting);
  if (state->usable > sequence->waiting) {
    state->mode = AMB_LIFTING;
    state->unusable = 0U;
    state->limited = 0U;
  }
}

/* Consistency after a bit flip: lifting and landing imply currents on, levitation the full way, all
 * other modes none of it. */
static void mend(amb_sequence_state *state)
{
  const bool there = (state->mode == AMB_FLYING) || !AMB_WITHIN(state->share, AMB_C(1.0));
  if (amb_sequence_on(state)) {
    state->share = there ? AMB_C(1.0) : state->share;
  } else if (state->mode > AMB_TRIPPED) {
    state->mode = (state->share > AMB_C(0.0)) ? AMB_LIFTING : AMB_TRIPPED;
  } else if (state->share > AMB_C(0.0)) {
    state->mode = AMB_LIFTING;
  } else { /* off, at the start of the way */
  }
}

amb_flight_mode amb_sequence_step(const amb_sequence *sequence, amb_sequence_state *state, bool fly,
                                  bool usable, bool limited)
{
  /* The next mode, without and with the command to levitate. */
  static const amb_flight_mode next_mode[][2] = {
      {AMB_OFF, AMB_WAITING},    {AMB_OFF, AMB_WAITING},     {AMB_LANDING, AMB_LIFTING},
      {AMB_LANDING, AMB_FLYING}, {AMB_LANDING, AMB_LIFTING}, {AMB_OFF, AMB_TRIPPED}};
  mend(state);
  if (amb_sequence_on(state)) {
    state->unusable = counted(state->unusable, !usable, sequence->lost);
    state->limited = counted(state->limited, limited, sequence->overloaded);
    if ((state->unusable > sequence->lost) || (state->limited > sequence->overloaded)) {
      amb_sequence_trip(state);
    }
  }
  /* any other value: a bit in memory has flipped */
  const amb_flight_mode before = (state->mode <= AMB_TRIPPED) ? state->mode : AMB_TRIPPED;
  state->mode = next_mode[before][fly ? 1 : 0];
  if ((before == AMB_TRIPPED) && !fly) {
    amb_sequence_init(state);
  } else if (state->mode != before) {
    state->usable = (state->mode == AMB_WAITING) ? 0U : state->usable;
  } else if (before == AMB_WAITING) {
    wait(sequence, state, usable);
  } else if (before == AMB_LIFTING) {
    rise(sequence, state);
  } else if (before == AMB_LANDING) {
    sink(sequence, state);
  } else { /* unchanged */
  }
  return state->mode;
}

amb_real amb_sequence_way(const amb_sequence_state *state)
{
  const amb_real s = state->share;
  return (s * s) * (AMB_C(3.0) - (AMB_C(2.0) * s));
}
