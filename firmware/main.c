/* An exported filter on a Cortex-M4F: its self-test, and a recorded run.
 *
 * The build selects the export, with -DHEADER="\"NAME_selftest.h\"" and -Dfilter_step=NAME_step and
 * so on (firmware/harness.py). Reads input.bin, writes output.bin; the printed text is for people.
 */
#include HEADER
#include "counting.h"
#include "semihosting.h"
#include <stdint.h>

#define MOST_SAMPLES 20000U

typedef struct sample {
  amb_real y; /* measurement [m] */
  amb_real u; /* control signal since the last sample [V] */
} sample;

typedef struct answer {
  amb_real x, v, f_d, x_m;
  uint32_t status;
  uint32_t instructions; /* of this step; 0 for the first sample, a reset */
  uint32_t trusted;      /* of the unchecked step; 0 if there is none */
} answer;

typedef struct summary {
  uint32_t unequal, wrong_status; /* of the self-test */
  uint32_t stack;                 /* bytes of stack used by a step */
  uint32_t state;                 /* bytes of an instance */
  uint32_t selftest;              /* instructions of the self-test, in units of 40 */
} summary;

typedef amb_status step_function(filter_state *state, amb_real y, amb_real u,
                                 filter_estimates *estimates);

static sample input[MOST_SAMPLES];
static answer output[MOST_SAMPLES];

/* The compiler may not move work across the counter readings, so the call goes through a pointer
 * whose target it cannot know. */
static uint32_t count(step_function *volatile step, const filter_state *state, const sample *s)
{
  filter_state copy;
  filter_estimates now;
  step_function *const call = step;
  const uint32_t before = ticks();
  for (unsigned int i = 0; i < REPEATS; i++) {
    copy = *state;
    (void)call(&copy, s->y, s->u, &now);
  }
  return ticks_since(before);
}

/* Two instructions: subtracts the overhead of the counting loop. */
static amb_status nothing(filter_state *state, amb_real y, amb_real u, filter_estimates *estimates)
{
  (void)state;
  (void)y;
  (void)u;
  (void)estimates;
  return AMB_OK;
}

static uint32_t instructions(const filter_state *state, const sample *s)
{
  return count(filter_step, state, s) - count(nothing, state, s) + INSTRUCTIONS_OF_NOTHING;
}

#ifdef filter_step_trusted
/* The unchecked step returns nothing and takes no estimates. It is counted inside a function that
 * returns a status; the cost of the same function without it is subtracted. */
typedef void trusted_function(filter_state *state, amb_real y, amb_real u);

static void only_returns(filter_state *state, amb_real y, amb_real u)
{
  (void)state;
  (void)y;
  (void)u;
}

static trusted_function *volatile inner;

static amb_status around(filter_state *state, amb_real y, amb_real u, filter_estimates *estimates)
{
  (void)estimates;
  inner(state, y, u);
  return AMB_OK;
}

static uint32_t trusted_instructions(const filter_state *state, const sample *s)
{
  inner = only_returns;
  const uint32_t frame = count(around, state, s);
  inner = filter_step_trusted;
  return count(around, state, s) - frame + 1U;
}
#else /* available for the paper's filter only */
static uint32_t trusted_instructions(const filter_state *state, const sample *s)
{
  (void)state;
  (void)s;
  return 0;
}
#endif

/* Bytes of stack used by a step. */
__attribute__((noinline)) static uint32_t stack_bytes(const filter_state *state, const sample *s)
{
  filter_state copy = *state;
  filter_estimates now;
  volatile uint32_t *const top = painted();
  (void)filter_step(&copy, s->y, s->u, &now);
  return used_below(top);
}

static void keep(answer *to, const filter_estimates *now, amb_status status)
{
  to->x = now->x;
  to->v = now->v;
  to->f_d = now->f_d;
  to->x_m = now->x_m;
  to->status = status;
}

static void run(size_t n, summary *found)
{
  filter_state state;
  filter_estimates now;
  filter_init(&state);
  amb_status status = filter_reset(&state, input[0].y, &now);
  keep(&output[0], &now, status);
  for (size_t k = 1; k < n; k++) {
    const uint32_t stack = stack_bytes(&state, &input[k]);
    found->stack = stack > found->stack ? stack : found->stack;
    output[k].instructions = instructions(&state, &input[k]);
    output[k].trusted = trusted_instructions(&state, &input[k]);
    status = filter_step(&state, input[k].y, input[k].u, &now);
    keep(&output[k], &now, status);
  }
}

int main(void)
{
  summary found = {0, 0, 0, sizeof(filter_state), 0};
  filter_selftest_result selftest;
  start_ticks();
  const uint32_t before = ticks();
  filter_selftest(&selftest);
  found.selftest = ticks_since(before) * INSTRUCTIONS_A_TICK;
  found.unequal = selftest.unequal;
  found.wrong_status = selftest.wrong_status;
  semihosting_print_number(found.unequal, " states of the self-test differ\n");
  semihosting_print_number(found.wrong_status, " statuses of the self-test differ\n");

  const size_t n = semihosting_read("input.bin", input, sizeof input) / sizeof input[0];
  if (n > 0)
    run(n, &found);
  semihosting_print_number((unsigned int)n, " samples\n");
  const bool written = semihosting_write("output.bin", output, n * sizeof output[0]) &&
                       semihosting_write("summary.bin", &found, sizeof found);
  return written ? 0 : 1;
}
