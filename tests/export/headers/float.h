/* Of a machine whose char and int have 16 bits, for tests/portability.py. */
#ifndef TEST_FLOAT_H
#define TEST_FLOAT_H

#define FLT_MANT_DIG 24
#define FLT_MAX 3.40282347e+38F
#define FLT_MIN 1.17549435e-38F
#define DBL_MANT_DIG 53
#define DBL_MAX 1.7976931348623157e+308
#define DBL_MIN 2.2250738585072014e-308

#endif
