/* What a sample found, from the interrupt that takes it to a task that sends it away: a ring of
 * frames, written by the one and read by the other, without locks.
 *
 * A frame is so many words of 32 bits, each sent with its lowest byte first:
 *
 *   AMB_TELEMETRY_SYNC
 *   layout    which export it comes from, and so what its numbers are
 *   count     of samples since the start; those that found no room count too, and are missing
 *   flags     the status in the lower 16 bits, what else there is to tell above
 *   numbers   IEEE 754, single precision
 *   check     CRC-32 of all words before (ambkit/crc.h)
 */
#ifndef AMBKIT_TELEMETRY_H
#define AMBKIT_TELEMETRY_H

#include "ambkit/real.h"
#include <stdint.h>

AMB_EXTERN_C_BEGIN

#define AMB_TELEMETRY_SYNC ((((uint32_t)0x4642U) << 16) | 0x4D41U) /* the bytes "AMBF" */
#define AMB_TELEMETRY_AROUND 5 /* words of a frame besides its numbers */

typedef struct amb_telemetry {
  volatile uint32_t *words; /* memory of all frames */
  uint32_t layout;
  uint32_t count;
  unsigned int numbers;          /* of a frame */
  unsigned int frames;           /* a power of two */
  volatile unsigned int written; /* frames; changed by the sampling interrupt only */
  volatile unsigned int taken;   /* frames; changed by the background task only */
} amb_telemetry;

/* Start with an empty ring. words: frames * (numbers + AMB_TELEMETRY_AROUND) of them, the caller's;
 * frames: a power of two. */
void amb_telemetry_init(amb_telemetry *ring, volatile uint32_t words[], unsigned int numbers,
                        unsigned int frames, uint32_t layout);

/* After a sample: store a frame. False if the ring is full, which is then unchanged. */
bool amb_telemetry_put(amb_telemetry *ring, uint32_t flags, const amb_real numbers[]);

/* In the background: remove the oldest frame, numbers + AMB_TELEMETRY_AROUND words. False if there
 * is none. */
bool amb_telemetry_take(amb_telemetry *ring, uint32_t frame[]);

AMB_EXTERN_C_END

#endif
