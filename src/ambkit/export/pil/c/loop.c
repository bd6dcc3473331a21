/* An exported controller on a Cortex-M4F in a loop with a plant elsewhere: sample by sample it
 * takes from one pipe what the sensor shows, and gives into another one what it demands.
 *
 * The build says which export, with -DHEADER="\"NAME_selftest.h\"" and -Drig_step=NAME_step and so
 * on (build.py). */
#include HEADER
#include TELEMETRY
#include "counting.h"
#include "semihosting.h"
#include <stdint.h>

#define COILS 2
#define SENT_EVERY 10U /* samples; fewer than the ring has room for */

typedef struct sample {
  amb_real y; /* as the rig has it */
  amb_real r; /* [m] */
  uint32_t fly;
  uint32_t counted; /* whether the instructions of this step are wanted; 2: the end */
} sample;

typedef struct answer {
  amb_real coil[COILS], iu, u, mean[4];
  uint32_t status, mode, on, usable;
  uint32_t instructions; /* of this step, where they were wanted */
  uint32_t stack;        /* bytes that a step has needed below its caller until now, likewise */
} answer;

typedef struct greeting {
  uint32_t unequal, wrong_status, wrong; /* of the self-test */
  uint32_t selftest;                     /* its instructions, in units of 40 */
  uint32_t state;                        /* bytes of an instance */
} greeting;

static uint32_t deepest;
static rig_telemetry frames;

typedef amb_status step_function(rig_state *state, amb_real y, amb_real r, bool fly,
                                 rig_output *out);

static amb_status nothing(rig_state *state, amb_real y, amb_real r, bool fly, rig_output *out)
{
  (void)state;
  (void)y;
  (void)r;
  (void)fly;
  (void)out;
  return AMB_OK;
}

static uint32_t count(step_function *volatile step, const rig_state *state, const sample *s)
{
  rig_state copy;
  rig_output out;
  step_function *const call = step;
  const uint32_t before = ticks();
  for (unsigned int i = 0; i < REPEATS; i++) {
    copy = *state;
    (void)call(&copy, s->y, s->r, s->fly != 0U, &out);
  }
  return ticks_since(before);
}

/* Bytes of stack that a step needs below its caller. */
__attribute__((noinline)) static uint32_t stack_bytes(const rig_state *state, const sample *s)
{
  rig_state copy = *state;
  rig_output out;
  volatile uint32_t *const top = painted();
  (void)rig_step(&copy, s->y, s->r, s->fly != 0U, &out);
  return used_below(top);
}

static void look(const rig_state *state, const sample *s, answer *said)
{
  said->instructions = count(rig_step, state, s) - count(nothing, state, s);
  said->instructions += INSTRUCTIONS_OF_NOTHING;
  const uint32_t stack = stack_bytes(state, s);
  deepest = (stack > deepest) ? stack : deepest;
  said->stack = deepest;
}

static void tell(const rig_output *out, amb_status status, answer *said)
{
  const amb_real mean[] = MEANS(out);
  for (int k = 0; k < RIG_COILS; k++)
    said->coil[k] = out->coil[k];
  said->iu = out->iu;
  said->u = out->u;
  for (int i = 0; i < 4; i++)
    said->mean[i] = mean[i];
  said->status = status;
  said->mode = (uint32_t)out->mode;
  said->on = out->on ? 1U : 0U;
  said->usable = out->usable ? 1U : 0U;
}

/* What a slower task does: send all frames that there are. */
static bool send(intptr_t file)
{
  uint32_t words[RIG_TELEMETRY_WORDS];
  while (rig_telemetry_take(&frames, words)) {
    if (!semihosting_give(file, words, sizeof words))
      return false;
  }
  return true;
}

static bool fly(intptr_t from, intptr_t to, intptr_t file)
{
  rig_state state;
  sample s;
  unsigned int waiting = 0;
  rig_init(&state);
  rig_telemetry_init(&frames);
  while (semihosting_take(from, &s, sizeof s) && (s.counted < 2U)) {
    answer said = {{0}, 0, 0, {0}, 0, 0, 0, 0, 0, 0};
    rig_output out;
    if (s.counted == 1U)
      look(&state, &s, &said);
    const amb_status status = rig_step(&state, s.y, s.r, s.fly != 0U, &out);
    (void)rig_telemetry_put(&frames, &out, status);
    if ((++waiting % SENT_EVERY) == 0U && !send(file))
      return false;
    tell(&out, status, &said);
    if (!semihosting_give(to, &said, sizeof said))
      return false;
  }
  return send(file);
}

int main(void)
{
  rig_selftest_result selftest;
  start_ticks();
  const uint32_t before = ticks();
  rig_selftest(&selftest);
  const greeting hello = {selftest.unequal, selftest.wrong_status, selftest.wrong,
                          ticks_since(before), sizeof(rig_state)};
  const intptr_t from = semihosting_open("samples", false);
  const intptr_t to = semihosting_open("answers", true);
  const intptr_t file = semihosting_open("frames", true);
  if ((from < 0) || (to < 0) || (file < 0) || !semihosting_give(to, &hello, sizeof hello))
    return 1;
  return fly(from, to, file) ? 0 : 1;
}
