/* A matrix by its nonzero entries. */
#ifndef AMBKIT_SPARSE_H
#define AMBKIT_SPARSE_H

#include "ambkit/real.h"

/* Its entries, row by row, columns ascending: those of row i are start[i] to start[i + 1]. */
typedef struct amb_sparse {
  const unsigned short *start;
  const unsigned short *column;
  const amb_real *value;
} amb_sparse;

/* A row times a vector, from its first entry on. */
static inline amb_real amb_sparse_times(const amb_sparse *A, const amb_real *value, int row,
                                        const amb_real x[])
{
  amb_real sum = AMB_C(0.0);
  for (int k = A->start[row]; k < (int)A->start[row + 1]; k++) {
    sum += value[k] * x[A->column[k]];
  }
  return sum;
}

#endif
