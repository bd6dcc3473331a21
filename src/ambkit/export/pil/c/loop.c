/* An exported controller on a Cortex-M4F in a loop with an external plant: at each sample it reads
 * the measurements from one pipe, and writes its demands to another.
 *
 * The build defines -DSEVERAL for several axes, -DSTATES as the number of states, and -DMEANS(out)
 * as the fields of its estimates (build.py).
 */
#include "controller.h"
#include "counting.h"
#include "semihosting.h"
#include <stdint.h>

#define SENT_EVERY 10U /* samples; less than the size of the ring */

static uint32_t deepest;
static rig_telemetry frames;

typedef amb_status step_function(PARAMETERS);

static amb_status nothing(PARAMETERS) /* ignores all of them */
{
  return AMB_OK;
}

static uint32_t count(step_function *volatile step, const controller_state *state, const sample *s)
{
  controller_state copy;
  controller_output out;
  step_function *const call = step;
  const uint32_t before = ticks();
  for (unsigned int i = 0; i < REPEATS; i++) {
    copy = *state;
    (void)call(ARGUMENTS(&copy, s, &out));
  }
  return ticks_since(before);
}

/* Bytes of stack used by a step. */
__attribute__((noinline)) static uint32_t stack_bytes(const controller_state *state,
                                                      const sample *s)
{
  controller_state copy = *state;
  controller_output out;
  volatile uint32_t *const top = painted();
  (void)controller_step(ARGUMENTS(&copy, s, &out));
  return used_below(top);
}

static void look(const controller_state *state, const sample *s, answer *reply)
{
  reply->instructions = count(controller_step, state, s) - count(nothing, state, s);
  reply->instructions += INSTRUCTIONS_OF_NOTHING;
  const uint32_t stack = stack_bytes(state, s);
  deepest = (stack > deepest) ? stack : deepest;
  reply->stack = deepest;
}

static void tell(const controller_output *out, amb_status status, answer *reply)
{
  const amb_real mean[] = MEANS(ESTIMATES(out));
  tell_currents(out, reply);
  for (int i = 0; i < STATES; i++)
    reply->mean[i] = mean[i];
  reply->status = status;
  reply->mode = (uint32_t)out->mode;
  reply->on = out->on ? 1U : 0U;
  reply->usable = out->usable ? 1U : 0U;
}

/* Work of a slower task: send all stored frames. */
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
  static controller_state state;
  static sample s;
  unsigned int waiting = 0;
  controller_init(&state);
  rig_telemetry_init(&frames);
  while (semihosting_take(from, &s, sizeof s) && (s.counted < 2U)) {
    static answer reply;
    static controller_output out;
    if (s.failed != 0U)
      controller_deenergise(&state);
    reply.instructions = 0;
    reply.stack = 0;
    if (s.counted == 1U)
      look(&state, &s, &reply);
    const amb_status status = controller_step(ARGUMENTS(&state, &s, &out));
    (void)rig_telemetry_put(&frames, &out, status);
    if ((++waiting % SENT_EVERY) == 0U && !send(file))
      return false;
    tell(&out, status, &reply);
    if (!semihosting_give(to, &reply, sizeof reply))
      return false;
  }
  return send(file);
}

int main(void)
{
  static greeting hello;
  start_ticks();
  const uint32_t before = ticks();
  self_test(&hello);
  hello.selftest = ticks_since(before);
  hello.state = sizeof(controller_state);
  const intptr_t from = semihosting_open("samples", false);
  const intptr_t to = semihosting_open("answers", true);
  const intptr_t file = semihosting_open("frames", true);
  if ((from < 0) || (to < 0) || (file < 0) || !semihosting_give(to, &hello, sizeof hello))
    return 1;
  return fly(from, to, file) ? 0 : 1;
}
