/**
 * Cairn: a generative world inside a game engine. A world model makes few pictures of high quality (anchors) from the player's
 * controls, and motion-guided frame generation makes the frames between them. This header declares the whole interface: link
 * against the shared library, or load it at run time.
 *
 * Read it from the top: first version, results and logging, then what is created once (device, world), what is called in every
 * frame (pictures and controls, anchors, rollouts, guidance, presenters), statistics, and last what is experimental and may change.
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
 * These rules hold for all functions:
 *
 * Handles. A pointer to an object, such as cairn_world *, is a number that only the library understands; never dereference it. A
 * handle that is null, destroyed, of another kind or made up gives CAIRN_ERROR_INVALID_HANDLE. Every object with a create function
 * has a destroy function, which accepts null and waits for calls in flight. Objects keep alive what they need, so they may be
 * destroyed in any order.
 *
 * Threads. Functions that take a pointer to const may be called by any number of threads at the same time. Those that take a
 * pointer that is not const allow one call at a time: a concurrent one gets CAIRN_ERROR_BUSY and does nothing. Calls at the wrong
 * time do not corrupt memory.
 *
 * Structs. Set struct_size to the struct's sizeof, also in structs that the library fills, and set unused fields to zero: zero is
 * every field's default. A host compiled with an older header, whose structs are shorter, works with a newer library; a host with
 * newer structs works if it sets nothing that the library does not know. The library never writes past struct_size.
 *
 * Results. 0 is success, a positive number is not an error, a negative one is. In addition to the results named at a function, any
 * function may return CAIRN_ERROR_INTERNAL, any that takes a handle CAIRN_ERROR_POISONED, and any that may return CAIRN_ERROR_DEVICE
 * also CAIRN_ERROR_DEVICE_REMOVED, once the graphics device is lost. A failed call has changed nothing,
 * and has written none of its results. All text is UTF-8.
 *
 * Memory. Unless a function says otherwise, the library reads or writes the caller's memory during the call only. It refuses null
 * and misaligned pointers and buffers that are too short; it cannot detect other invalid pointers.
 *
 * Callbacks are called without a lock held and may call Cairn, but must not destroy an object that a call further up the stack is
 * using, and must not throw. The library starts threads only for objects that need them, and writes files only when asked to.
 */
