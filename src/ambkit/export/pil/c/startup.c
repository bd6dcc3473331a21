/* From reset to main on a Cortex-M4F: floating-point unit, .data, .bss. */
#include "semihosting.h"
#include <stdint.h>

/* From the linker script: addresses, not variables. */
extern uint32_t stack_top, data_start, data_end, data_load, bss_start, bss_end;

int main(void);
void reset(void);

static void fault(void)
{
  semihosting_print("fault\n");
  semihosting_exit(EXIT_FAULT);
}

/* Coprocessor access control register (ARMv7-M, B3.2.20): the unit is off after reset, and any
 * floating-point instruction before this is a fault. */
static void enable_fpu(void)
{
  volatile uint32_t *const cpacr = (volatile uint32_t *)0xE000ED88U;
  *cpacr |= 0xFU << 20; /* coprocessors 10 and 11, full access */
  __asm volatile("dsb\n\tisb" ::: "memory");
}

void reset(void)
{
  enable_fpu();
  const uint32_t *from = &data_load;
  for (uint32_t *to = &data_start; to < &data_end; to++)
    *to = *from++;
  for (uint32_t *to = &bss_start; to < &bss_end; to++)
    *to = 0;
  semihosting_exit(main());
}

/* The vector table: the stack, then the handlers of reset, NMI and the faults. No interrupts are
 * used. */
typedef struct vector_table {
  uint32_t *stack;
  void (*handlers[6])(void);
} vector_table;

__attribute__((section(".vectors"), used)) static const vector_table vectors = {
    &stack_top, {reset, fault, fault, fault, fault, fault}};
