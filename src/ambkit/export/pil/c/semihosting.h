/* Files, text and exit of the machine that runs the emulator (ARM, Semihosting for AArch32). */
#ifndef FIRMWARE_SEMIHOSTING_H
#define FIRMWARE_SEMIHOSTING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define EXIT_FAULT 3

/* Print text on the emulator's standard error. */
void semihosting_print(const char *text);

/* Print a number, then text. */
void semihosting_print_number(unsigned int number, const char *text);

/* Read a whole file from the emulator's folder; returns how many of the `size` bytes came. */
size_t semihosting_read(const char *name, void *to, size_t size);

/* Write a whole file; true if all bytes went. */
bool semihosting_write(const char *name, const void *from, size_t size);

/* Open a pipe of the machine that runs the emulator, and wait for the other end; less than 0: there
 * is none. */
intptr_t semihosting_open(const char *name, bool to_write);

/* Move `size` bytes from a pipe, or into one; false where the other end has closed it. */
bool semihosting_take(intptr_t pipe, void *to, size_t size);
bool semihosting_give(intptr_t pipe, const void *from, size_t size);

/* Leave the emulator with an exit code. */
_Noreturn void semihosting_exit(int code);

#endif
