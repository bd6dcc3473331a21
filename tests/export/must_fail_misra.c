/* What the MISRA check must find: each line ends with the rules that it breaks. Compiled by nobody;
 * tests/test_misra.py reads it. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int counter; /* 8.4, 8.7 */

static int recursive(int n)
{
  return (n > 0) ? recursive(n - 1) : 0; /* 17.2 */
}

double mixed(float narrow, int whole) /* 8.4 */
{
  double *heap = malloc(8U); /* 11.5, 21.3 */
  union bits {               /* 19.2 */
    float number;
    unsigned int pattern;
  } bits; /* 19.2 */
  bits.number = narrow;
  if (whole)              /* 14.4, 15.6 */
    counter = whole << 1; /* 10.1 */
  whole = narrow;         /* 10.3, 17.8 */
  goto end;               /* 15.1 */
end:
  memcpy(heap, &bits, 4U);             /* 17.7, 21.15 */
  printf("%d\n", recursive(whole));    /* 17.7, 21.6 */
  return narrow * whole + *(heap + 1); /* 10.4, 12.1, 18.4 */
}
