/* Which precision the core computes in, where the build does not say it with -DAMB_FLOAT or
 * -DAMB_DOUBLE. An export has a file of its own here. */
#ifndef AMBKIT_PRECISION_H
#define AMBKIT_PRECISION_H

#if !defined(AMB_FLOAT) && !defined(AMB_DOUBLE)
#define AMB_DOUBLE
#endif

#endif
