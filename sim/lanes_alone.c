/* The core's loop along a record, one run at a time, compiled for each instruction set. */
#include "lanes_run.h"

#if defined(AMB_HAS_LANES) && (AMB_LANES_BYTES > 16)
#define amb_kalman_run AMB_LANES_NAME(amb_kalman_run)
#define amb_kalman_note AMB_LANES_NAME(amb_kalman_note)
#include "src/kalman_run.c"
#endif
