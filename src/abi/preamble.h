/**
 * Cairn: a generative world inside a game engine. A world model draws few, strong pictures (anchors) from the player's
 * controls; motion-guided frame generation fills in the rest. This header is the whole library: load the shared library with
 * it, or link against it.
 *
 * It is a course, to be read from the top: what it promises (version, results, logging), what is created once (device, world),
 * what is done in every frame (pictures and controls, anchors, rollouts, guidance, presenters), what can be asked, and last
 * what may still change.
 *
 * A rollout, from a seed picture to the pictures of one second:
 *
 *     cairn_result play(const char *path, const cairn_picture *seed, const cairn_target *target)
 *     {
 *         cairn_device *device = NULL;
 *         cairn_world *world = NULL;
 *         cairn_rollout *rollout = NULL;
 *         cairn_world_options options = {.struct_size = sizeof options, .path = path};
 *         cairn_controls walk = {.struct_size = sizeof walk, .keys = {0, 1ull << 23}}; // W
 *         cairn_result r = cairn_device_create_cpu(NULL, &device);
 *         if (r == CAIRN_OK) r = cairn_world_load(device, &options, &world);
 *         if (r == CAIRN_OK) r = cairn_rollout_create(world, NULL, &rollout);
 *         if (r == CAIRN_OK) r = cairn_rollout_append(rollout, seed, NULL);
 *         for (int i = 0; i < 15 && r == CAIRN_OK; i++) {
 *             cairn_anchor *anchor = NULL;
 *             r = cairn_rollout_step(rollout, &walk, NULL);
 *             if (r == CAIRN_OK) r = cairn_rollout_get_anchor(rollout, &anchor);
 *             if (r == CAIRN_OK) r = cairn_anchor_read_picture(anchor, 0, target);
 *             cairn_anchor_destroy(anchor); // what can be destroyed may be null
 *         }
 *         cairn_rollout_destroy(rollout);
 *         cairn_world_destroy(world);
 *         cairn_device_destroy(device); // any order will do
 *         return r; // if negative, cairn_last_error() has the message
 *     }
 *
 * The rules, once:
 *
 * Handles. A pointer to an object, such as cairn_world *, is a number to be handed back, never memory to be read. One that is
 * null, stale, of another object or made up gives CAIRN_ERROR_INVALID_HANDLE. What has a create function has a destroy
 * function, which takes null and waits for calls in flight. Objects keep what they need alive, so the order does not matter.
 *
 * Threads. Through a pointer to const, any number of threads may call at the same time. Through a pointer that is not const,
 * one call at a time: a second one beside it gets CAIRN_ERROR_BUSY and does nothing. Nothing a thread does wrong here corrupts
 * memory.
 *
 * Structs. Set struct_size to the struct's sizeof, also of structs that the library fills, and zero what you do not set: zero
 * is every field's default. Hosts compiled with an older header, whose structs are shorter, are understood; so are newer ones
 * as long as they ask for nothing this library does not know. The library never writes past struct_size.
 *
 * Results. 0 is success, a positive number is not an error, a negative one is; besides those named at a function, any may
 * answer CAIRN_ERROR_INTERNAL, and any that takes a handle CAIRN_ERROR_POISONED. A call that fails has done nothing, and has
 * written none of its results. All text is UTF-8.
 *
 * Memory. What the caller passes is read or written during the call and not kept, where it is not said otherwise. Null,
 * misaligned and too short buffers are refused; a pointer to something else altogether cannot be caught.
 *
 * Callbacks are called without a lock held and may call Cairn, but must not destroy what a call further up is using, and must
 * not throw. The library starts no thread before an object that needs one, and writes no file unless asked.
 */
