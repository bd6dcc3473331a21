#ifndef TEST_STDDEF_H
#define TEST_STDDEF_H

typedef unsigned long size_t;

#define NULL ((void *)0)

#endif
