/* A char of 16 bits: int8_t and uint8_t are here for no other reason than to be found. */
#ifndef TEST_STDINT_H
#define TEST_STDINT_H

typedef signed char int8_t;
typedef unsigned char uint8_t;
typedef int int16_t;
typedef unsigned int uint16_t;
typedef long int32_t;
typedef unsigned long uint32_t;
typedef unsigned long long uint64_t;

#define UINT16_C(literal) literal##U
#define UINT32_C(literal) literal##UL
#define UINT64_C(literal) literal##ULL

#endif
