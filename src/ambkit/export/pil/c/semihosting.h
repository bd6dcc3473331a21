/* Files, text and exit on the host of the emulator (ARM, Semihosting for AArch32). */
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

/* Read a file from the emulator's folder; returns the number of bytes read, up to `size`. */
size_t semihosting_read(const char *name, void *to, size_t size);

/* Write a file; true if all bytes were written. */
bool semihosting_write(const char *name, const void *from, size_t size);

/* Open a pipe of the host, and wait for the other end; negative if it does not exist. */
intptr_t semihosting_open(const char *name, bool to_write);

/* Transfer `size` bytes from or to a pipe; false if the other end has closed it. */
bool semihosting_take(intptr_t pipe, void *to, size_t size);
bool semihosting_give(intptr_t pipe, const void *from, size_t size);

/* Leave the emulator with an exit code. */
_Noreturn void semihosting_exit(int code);

#endif
