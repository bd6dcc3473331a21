/* Instructions and stack of a call on qemu's Cortex-M. */
#ifndef FIRMWARE_COUNTING_H
#define FIRMWARE_COUNTING_H

#include <stdint.h>

/* With `-icount shift=0` an instruction takes 1 ns and SysTick counts every 40 ns: for 40 equal
 * calls, ticks are instructions per call. */
#define INSTRUCTIONS_A_TICK 40U
#define REPEATS INSTRUCTIONS_A_TICK

/* A function that only returns 0: subtracts the overhead of the counting loop. */
#define INSTRUCTIONS_OF_NOTHING 2U

/* SysTick (ARMv7-M, B3.3), 24 bits, counts down at the processor clock. */
#define SYSTICK ((volatile uint32_t *)0xE000E010U)

static inline void start_ticks(void)
{
  SYSTICK[1] = 0xFFFFFFU;
  SYSTICK[2] = 0;
  SYSTICK[0] = 5;
}

static inline uint32_t ticks(void)
{
  return SYSTICK[2];
}

static inline uint32_t ticks_since(uint32_t before)
{
  return (before - ticks()) & 0xFFFFFFU;
}

/* Maximum stack of a call in words, and the value that marks unused ones. */
#define STACK_WORDS 8192U
#define UNUSED 0xA5A5A5A5U

/* Mark the stack below the calling function, which must not be inline; returns its start. */
__attribute__((always_inline)) static inline volatile uint32_t *painted(void)
{
  volatile uint32_t *top;
  __asm volatile("mov %0, sp" : "=r"(top));
  for (unsigned int i = 1; i <= STACK_WORDS; i++)
    *(top - i) = UNUSED;
  return top;
}

/* Bytes down to the deepest overwritten word. */
__attribute__((always_inline)) static inline uint32_t used_below(const volatile uint32_t *top)
{
  unsigned int depth = STACK_WORDS;
  while ((depth > 0U) && (*(top - depth) == UNUSED))
    depth--;
  return depth * (uint32_t)sizeof *top;
}

#endif
