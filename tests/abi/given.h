/* Objects that a host gives to the library: of Direct3D 12 on Windows, and elsewhere memory, into which the library never looks. */
#ifndef CAIRN_TEST_GIVEN_H
#define CAIRN_TEST_GIVEN_H

#include <stdint.h>

/* Objects of a host; null where there is no Direct3D 12. */
struct given {
    void *device, *queue, *compute;
    /* RGBA8 of 128 x 72 pixels in the state COMMON. */
    void *texture;
    /* An open list for the queue; it is never executed. */
    void *list;
    void *fence;
    /* A value that the fence does not have yet. */
    uint64_t fence_value;
    void *factory, *window, *window_description, *description;
};

#ifdef _WIN32
/* Creates all of them; the process ends if one cannot be created. */
void given_create(struct given *given);
/* Ends the use of the list by recordings: the fence gets its value, and the next one waits for a later value. */
void given_end_recordings(struct given *given);
/* Releases a reference that the library has given. */
void given_release(void *object);
/* Waits until a fence has a value. */
void given_wait(void *fence, uint64_t value);
/* The references to device and queue, once they are as expected, or after a while: a driver's thread may release late. */
int given_has_references(const struct given *given, const unsigned long expected[2]);
void given_references(const struct given *given, unsigned long found[2]);
#endif

#endif
