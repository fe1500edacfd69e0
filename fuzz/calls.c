/* Turns bytes into calls of the C interface, for the fuzz target `calls`. */
#include "../tests/abi/play.h"

void cairn_fuzz_calls(const unsigned char *bytes, size_t size);

/* Without a world, only objects that need none exist. Sequences are then short, so that more of them run. */
static void make_stage(void)
{
    if (getenv("CAIRN_TEST_WORLD")) {
        create_objects(make_device());
    } else {
        objects[ANCHOR] = create_anchor(7);
        create_objects_without_world();
    }
}

void cairn_fuzz_calls(const unsigned char *bytes, size_t size)
{
    static int ready;
    if (!ready) make_stage();
    ready = 1;
    struct bytes from = {bytes, size};
    play(&from);
    if (objects[QUEUE]) {
        OK(cairn_rollout_cancel(objects[QUEUE]));
        OK(cairn_rollout_pause(objects[QUEUE]));
    }
    if (failed_checks) abort();
}
