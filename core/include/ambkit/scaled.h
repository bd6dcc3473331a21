/* The force of another magnet, times a factor: `self` is an amb_scaled. */
#ifndef AMBKIT_SCALED_H
#define AMBKIT_SCALED_H

#include "ambkit/magnet.h"

AMB_EXTERN_C_BEGIN

typedef struct amb_scaled {
  amb_magnet of;
  amb_real scale; /* [1] */
} amb_scaled;

extern const amb_magnet_methods amb_scaled_magnet;

AMB_EXTERN_C_END

#endif
