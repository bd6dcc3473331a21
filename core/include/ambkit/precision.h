/* Default precision of the core, unless the build defines AMB_FLOAT or AMB_DOUBLE. An export has
 * its own version of this file. */
#ifndef AMBKIT_PRECISION_H
#define AMBKIT_PRECISION_H

#if !defined(AMB_FLOAT) && !defined(AMB_DOUBLE)
#define AMB_DOUBLE
#endif

#endif
