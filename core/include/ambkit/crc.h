/* CRC-32 of numbers (IEEE 802.3, reflected, 0xEDB88320), each from its lowest byte to its highest:
 * independent of the processor's byte order, padding and size of a char.
 *
 * Start with AMB_CRC_START and invert all bits of the result; for "123456789" that is 0xCBF43926.
 */
#ifndef AMBKIT_CRC_H
#define AMBKIT_CRC_H

#include "ambkit/exponential.h"

#define AMB_CRC_START (~(uint32_t)0U)
#define AMB_CRC_POLYNOMIAL ((((uint32_t)0xEDB8U) << 16) | 0x8320U)

/* The lowest 32 bits of a number, bit by bit: a table would need more flash than the data. */
static inline uint32_t amb_crc_word(uint32_t crc, uint32_t word)
{
  uint32_t sum = crc ^ word;
  for (int bit = 0; bit < 32; bit++) {
    sum = ((sum & 1U) != 0U) ? ((sum >> 1) ^ AMB_CRC_POLYNOMIAL) : (sum >> 1);
  }
  return sum;
}

static inline uint32_t amb_crc_real(uint32_t crc, amb_real a)
{
  amb_bits as;
  as.number = a;
#if defined(AMB_FLOAT)
  return amb_crc_word(crc, as.bits);
#else
  const uint32_t low = amb_crc_word(crc, (uint32_t)as.bits);
  return amb_crc_word(low, (uint32_t)(as.bits >> 32));
#endif
}

static inline uint32_t amb_crc_reals(uint32_t crc, const amb_real values[], int n)
{
  uint32_t sum = crc;
  for (int i = 0; i < n; i++) {
    sum = amb_crc_real(sum, values[i]);
  }
  return sum;
}

#endif
