/* Fault isolation beside an exported filter on a Cortex-M4F: its self-test, and the instructions of
 * a sample and of a search over a full window, with and without a fault. Reads input.bin as main.c;
 * writes instructions.bin. How instructions are counted: README.md. */
#include HEADER
#include "counting.h"
#include "semihosting.h"
#include <stdint.h>

#define MOST_SAMPLES 4000U

typedef struct sample {
  amb_real y; /* measurement [m] */
  amb_real u; /* control signal since the last sample [V] */
} sample;

static sample input[MOST_SAMPLES];
static filter_faults faults;
static amb_isolation_result results[FILTER_FAULTS];

static uint32_t search(int *named)
{
  const uint32_t before = ticks();
  *named = filter_faults_search(&faults, results);
  return ticks_since(before) * INSTRUCTIONS_A_TICK;
}

int main(void)
{
  static filter_state state;
  static filter_estimates now;
  uint32_t counted[3];
  int named = 0;
  start_ticks();
  if (filter_selftest_faults(&faults) != 0U)
    return 1;
  const size_t n = semihosting_read("input.bin", input, sizeof input) / sizeof input[0];
  amb_status status = filter_reset(&state, input[0].y, &now);
  filter_faults_init(&faults);
  for (size_t k = 1; k < n; k++) {
    filter_faults_put(&faults, &state, &now, status);
    if (k == n / 2) {
      counted[1] = search(&named);
      if (named != 0)
        return 2;
    }
    status = filter_step(&state, input[k].y, input[k].u, &now);
  }
  counted[2] = search(&named);
  if (named == 0)
    return 3;
  const uint32_t before = ticks();
  for (unsigned int i = 0; i < REPEATS; i++)
    filter_faults_put(&faults, &state, &now, status);
  counted[0] = ticks_since(before);
  return semihosting_write("instructions.bin", counted, sizeof counted) ? 0 : 4;
}
