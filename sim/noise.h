/* Normal noise that is a function of four numbers: seed, run, stream and sample. Who draws it,
 * where, when and beside whom changes nothing, so that runs can be computed in any order.
 *
 * Philox 4x32-10 (Salmon, Moraes, Dror and Shaw 2011) with the seed as its key; the counter is made
 * of run, stream and half of the sample's number. What it gives becomes normal by the inverse of
 * the distribution (Wichura 1988, AS 241), to some 1e-16; no libm beyond the root.
 */
#ifndef AMBKIT_SIM_NOISE_H
#define AMBKIT_SIM_NOISE_H

#include <stddef.h>
#include <stdint.h>

/* Whose noise it is. */
typedef struct amb_noise_key {
  uint64_t seed, run;
} amb_noise_key;

/* The streams of an axis and its sensor; those of others are the caller's. */
#define AMB_NOISE_CONTROL 0U  /* on the control signal */
#define AMB_NOISE_SENSOR 1U   /* white, on the measurement */
#define AMB_NOISE_STREAMS 64U /* from those of an axis to those of the next */

#define AMB_NOISE_DRAWN 64U /* samples that are drawn together */

#endif
