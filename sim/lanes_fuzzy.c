/* The core's fuzzy network, compiled for each instruction set. */
#include "lanes_run.h"

#if defined(AMB_HAS_LANES) && (AMB_LANES_BYTES > 16)
#define amb_fuzzy_magnet AMB_LANES_NAME(amb_fuzzy_magnet)
#define amb_fuzzy_basis AMB_LANES_NAME(amb_fuzzy_basis)
#include "src/fuzzy.c"
#endif
