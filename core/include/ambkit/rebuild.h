/* The numbers of a model by loops (ambkit/loops.h), recomputed after a change of a physical
 * parameter: with the bits of an export with these parameters.
 *
 * The dependence of the continuous model on the parameters is data: the operations of Python's
 * parts in order, so that the equations are stated once. All memory is the caller's.
 */
#ifndef AMBKIT_REBUILD_H
#define AMBKIT_REBUILD_H

#include "ambkit/real.h"
#include "ambkit/sampling.h"

AMB_EXTERN_C_BEGIN

typedef enum amb_operation { AMB_ADD, AMB_SUBTRACT, AMB_MULTIPLY, AMB_DIVIDE } amb_operation;

typedef struct amb_rebuild {
  int parameters;    /* the first slots, ... */
  const double *low; /* [parameters]: minimum and maximum for the model's kind */
  const double *high;
  int constants; /* ... the next, ... */
  const double *constant;
  int operations;                 /* ... and a slot for each result */
  const unsigned char *operation; /* [operations], amb_operation of two slots before it */
  const unsigned short *left;
  const unsigned short *right;
  amb_plan plan;               /* but for its numbers: value, k_i, intensity; these are slots: */
  const unsigned short *value; /* [terms] */
  const unsigned short *k_i;   /* [forces] */
  const unsigned short *intensity; /* noises x states */
  int numbers;
  const unsigned int *from; /* [numbers]: place in Phi, then N of the noises, then the slots */
} amb_rebuild;

/* Size of the workspace. */
int amb_rebuild_room(const amb_rebuild *of);

/* The model's numbers, in the order L, b, B_u, h, e, r, d, c, N, rest. Returns false with the
 * numbers unchanged if a parameter is beyond its limits or a number is not finite. */
bool amb_rebuild_numbers(const amb_rebuild *of, const double parameters[], amb_real numbers[],
                         double room[]);

AMB_EXTERN_C_END

#endif
