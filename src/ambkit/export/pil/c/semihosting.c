#include "semihosting.h"
#include <stdint.h>
#include <string.h>

enum operation {
  SYS_OPEN = 0x01,
  SYS_CLOSE = 0x02,
  SYS_WRITE0 = 0x04,
  SYS_WRITE = 0x05,
  SYS_READ = 0x06,
  SYS_EXIT_EXTENDED = 0x20
};

enum { READ_BINARY = 1, WRITE_BINARY = 5 }; /* fopen's "rb" and "wb" */

#define APPLICATION_EXIT 0x20026U

static intptr_t call(enum operation operation, const void *argument)
{
  register intptr_t r0 __asm("r0") = operation;
  register const void *r1 __asm("r1") = argument;
  __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

void semihosting_print(const char *text)
{
  (void)call(SYS_WRITE0, text);
}

void semihosting_print_number(unsigned int number, const char *text)
{
  char digits[11];
  char *first = &digits[sizeof digits - 1];
  *first = '\0';
  do {
    *--first = (char)('0' + number % 10U);
    number /= 10U;
  } while (number > 0U);
  semihosting_print(first);
  semihosting_print(text);
}

static intptr_t open_file(const char *name, uintptr_t mode)
{
  const uintptr_t arguments[] = {(uintptr_t)name, mode, strlen(name)};
  return call(SYS_OPEN, arguments);
}

/* Read or write `size` bytes; returns the number that were not transferred. */
static size_t move(enum operation operation, intptr_t file, const void *bytes, size_t size)
{
  const uintptr_t arguments[] = {(uintptr_t)file, (uintptr_t)bytes, size};
  const size_t left = (size_t)call(operation, arguments);
  (void)call(SYS_CLOSE, &file);
  return left;
}

size_t semihosting_read(const char *name, void *to, size_t size)
{
  const intptr_t file = open_file(name, READ_BINARY);
  return file < 0 ? 0 : size - move(SYS_READ, file, to, size);
}

bool semihosting_write(const char *name, const void *from, size_t size)
{
  const intptr_t file = open_file(name, WRITE_BINARY);
  return (file >= 0) && (move(SYS_WRITE, file, from, size) == 0);
}

intptr_t semihosting_open(const char *name, bool to_write)
{
  return open_file(name, to_write ? WRITE_BINARY : READ_BINARY);
}

bool semihosting_take(intptr_t pipe, void *to, size_t size)
{
  unsigned char *next = to;
  size_t left = size;
  while (left > 0U) {
    const uintptr_t arguments[] = {(uintptr_t)pipe, (uintptr_t)next, left};
    const size_t missing = (size_t)call(SYS_READ, arguments);
    if (missing >= left)
      return false;
    next += left - missing;
    left = missing;
  }
  return true;
}

bool semihosting_give(intptr_t pipe, const void *from, size_t size)
{
  const uintptr_t arguments[] = {(uintptr_t)pipe, (uintptr_t)from, size};
  return call(SYS_WRITE, arguments) == 0;
}

_Noreturn void semihosting_exit(int code)
{
  const uintptr_t arguments[] = {APPLICATION_EXIT, (uintptr_t)code};
  (void)call(SYS_EXIT_EXTENDED, arguments);
  for (;;) {
  }
}
