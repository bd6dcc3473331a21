/* An exported filter of a machine on a Cortex-M4F: its self-test, and the instructions of its
 * steps.
 *
 * The build selects the export, as for main.c. Reads input.bin with the readings and control
 * signals of each sample; writes instructions.bin, a number per step. How instructions are counted:
 * README.md.
 */
#include HEADER
#include "counting.h"
#include "semihosting.h"
#include <stdint.h>

#define MOST_SAMPLES 2000U

typedef struct sample {
  amb_real y[AMB_SENSORS];
  amb_real u[AMB_CONTROLS]; /* since the last sample */
} sample;

typedef amb_status step_function(filter_state *state, const amb_real y[AMB_SENSORS],
                                 const amb_real u[AMB_CONTROLS], filter_estimates *estimates);

static sample input[MOST_SAMPLES];
static uint32_t instructions[MOST_SAMPLES];

static uint32_t count(step_function *volatile step, const filter_state *state, const sample *s)
{
  static filter_state copy;
  static filter_estimates now;
  step_function *const call = step;
  const uint32_t before = ticks();
  for (unsigned int i = 0; i < REPEATS; i++) {
    copy = *state;
    (void)call(&copy, s->y, s->u, &now);
  }
  return ticks_since(before);
}

/* Two instructions: subtracts the overhead of the counting loop. */
static amb_status nothing(filter_state *state, const amb_real y[AMB_SENSORS],
                          const amb_real u[AMB_CONTROLS], filter_estimates *estimates)
{
  (void)state;
  (void)y;
  (void)u;
  (void)estimates;
  return AMB_OK;
}

int main(void)
{
  static filter_state state;
  static filter_estimates now;
  static filter_selftest_result selftest;
  start_ticks();
  filter_selftest(&selftest);
  if ((selftest.unequal != 0U) || (selftest.wrong_status != 0U))
    return 1;
  const size_t n = semihosting_read("input.bin", input, sizeof input) / sizeof input[0];
  filter_init(&state);
  (void)filter_reset(&state, input[0].y, &now);
  for (size_t k = 1; k < n; k++) {
    instructions[k] = count(filter_step, &state, &input[k]) - count(nothing, &state, &input[k]) +
                      INSTRUCTIONS_OF_NOTHING;
    (void)filter_step(&state, input[k].y, input[k].u, &now);
  }
  semihosting_print_number(sizeof state, " bytes of state\n");
  return semihosting_write("instructions.bin", instructions, n * sizeof instructions[0]) ? 0 : 1;
}
