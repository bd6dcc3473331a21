/* Square matrices of doubles, row by row. */
#ifndef AMBKIT_SQUARE_H
#define AMBKIT_SQUARE_H

#include "ambkit/real.h"

AMB_INLINE bool amb_is_zero(double a)
{
  return (a >= 0.0) && (a <= 0.0);
}

AMB_INLINE void amb_square_copy(int count, const double from[], double to[])
{
  for (int i = 0; i < count; i++) {
    to[i] = from[i];
  }
}

AMB_INLINE void amb_square_identity(int n, double A[])
{
  for (int i = 0; i < (n * n); i++) {
    A[i] = ((i / n) == (i % n)) ? 1.0 : 0.0;
  }
}

/* to = A B / divisor, for a sparse A. */
AMB_INLINE void amb_square_multiply(int n, const double A[], const double B[], double divisor,
                                    double to[])
{
  for (int i = 0; i < n; i++) {
    double *row = &to[i * n];
    for (int j = 0; j < n; j++) {
      row[j] = 0.0;
    }
    for (int k = 0; k < n; k++) {
      if (!amb_is_zero(A[(i * n) + k])) {
        const double a = A[(i * n) + k] / divisor;
        const double *of = &B[k * n];
        for (int j = 0; j < n; j++) {
          row[j] += a * of[j];
        }
      }
    }
  }
}

#endif
