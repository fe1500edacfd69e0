using System;
using System.Collections.Generic;
using System.Runtime.InteropServices;

namespace Cairn
{
    /// <summary>Statistics of one step. Times are nanoseconds of wall time.</summary>
    public struct StepInfo
    {
        private readonly Native.step_info from;

        internal StepInfo(Native.step_info from)
        {
            this.from = from;
        }

        /// <summary>Whether keys and values of the latent, with joined passes of the one before, were written to the ring.</summary>
        public bool IsCommitted
        {
            get { return (from.flags & Native.STEP_COMMITTED) != 0; }
        }

        /// <summary>Number of the new latent, from 0.</summary>
        public long Latent
        {
            get { return (long)from.latent; }
        }

        /// <summary>Number of denoise passes.</summary>
        public int DenoisePasses
        {
            get { return (int)from.denoise_passes; }
        }

        /// <summary>Number of cache passes, which make keys and values for the ring.</summary>
        public int CachePasses
        {
            get { return (int)from.cache_passes; }
        }

        /// <summary>Time of encoding a picture.</summary>
        public long EncodeNs
        {
            get { return (long)from.encode_ns; }
        }

        /// <summary>Time of all denoise passes.</summary>
        public long DenoiseNs
        {
            get { return (long)from.denoise_ns; }
        }

        /// <summary>Time of all cache passes.</summary>
        public long CacheNs
        {
            get { return (long)from.cache_ns; }
        }

        /// <summary>Time of checking results and copying them into the ring.</summary>
        public long CommitNs
        {
            get { return (long)from.commit_ns; }
        }

        /// <summary>Time of decoding the latent.</summary>
        public long DecodeNs
        {
            get { return (long)from.decode_ns; }
        }

        /// <summary>Bytes written to the ring.</summary>
        public long RingBytes
        {
            get { return (long)from.ring_bytes; }
        }
    }

    /// <summary>Properties and progress of a rollout.</summary>
    public sealed unsafe class RolloutInfo
    {
        internal RolloutInfo(ref Native.rollout_info from)
        {
            PicturesPerLatent = (int)from.pictures_per_latent;
            Latents = (long)from.latents;
            Seed = from.seed;
            LatentsPerSecond = (int)from.latents_per_second;
            PresentedRate = (int)from.presented_rate;
            fixed (byte* point = from.operating_point) OperatingPoint = Text.Decode(point, 192);
        }

        /// <summary>Pictures per anchor.</summary>
        public int PicturesPerLatent { get; }

        /// <summary>Latents made so far.</summary>
        public long Latents { get; }

        /// <summary>Seed of its noise.</summary>
        public ulong Seed { get; }

        /// <summary>Latents per second of world time; each step's controls cover one such interval.</summary>
        public int LatentsPerSecond { get; }

        /// <summary>Pictures per second that the operating point presents.</summary>
        public int PresentedRate { get; }

        /// <summary>Operating point, in full.</summary>
        public string OperatingPoint { get; }
    }

    /// <summary>Budget of a rollout and its frames: time, memory or both.</summary>
    public sealed class Budget
    {
        /// <summary>Nanoseconds of device time per presented frame, including the anchors' share; 0 for no limit.</summary>
        public long FrameNs { get; set; }

        /// <summary>MiB for the world in use and its rollout; 0 for all that is available.</summary>
        public long MemoryMib { get; set; }

        /// <summary>Presented frames per anchor, at most 64; 0 for the presenter's, or for 1 without a presenter.</summary>
        public int Multiplier { get; set; }

        /// <summary>
        /// Schedules as in operating points, each with fewer passes than the previous one, at most 8: "stock", "explicit:1:0.5:0". Null for the
        /// rollout's own only.
        /// </summary>
        public IReadOnlyList<string> Schedules { get; set; }

        /// <summary>Worlds of the same bundle with other global windows, to which the rollout may switch, at most 8; may be null.</summary>
        public IReadOnlyList<World> Worlds { get; set; }

        /// <summary>The presenter whose frames share the budget; may be null.</summary>
        public Presenter Presenter { get; set; }
    }

    /// <summary>One running instance of a world: its KV ring, clocks and noise seed.</summary>
    /// <remarks>
    /// <see cref="Append(PictureView)"/>, <see cref="Step"/>, <see cref="Reset"/>, <see cref="Restore"/> and setting a budget exclude each
    /// other: during another of them, or while steps are queued, they throw <see cref="Result.Busy"/> and do nothing. All else may be called
    /// from any thread at any time; queries throw <see cref="Result.Busy"/> while a step is running.
    /// </remarks>
    public sealed unsafe class Rollout : CairnObject
    {
        internal Rollout(IntPtr value) : base(value, handle => Library.C.rollout_destroy(handle))
        {
        }

        /// <summary>Properties and progress.</summary>
        /// <exception cref="CairnException"><see cref="Result.Busy"/> while a step is running.</exception>
        public RolloutInfo Info
        {
            get
            {
                var native = new Native.rollout_info { struct_size = (uint)sizeof(Native.rollout_info) };
                CheckResult(Library.C.rollout_get_info(Value, &native));
                return new RolloutInfo(ref native);
            }
        }

        /// <summary>Statistics so far; does not wait for a running step.</summary>
        public RolloutStatistics Statistics
        {
            get
            {
                var native = new Native.rollout_statistics { struct_size = (uint)sizeof(Native.rollout_statistics) };
                CheckResult(Library.C.rollout_get_statistics(Value, &native));
                return new RolloutStatistics(native);
            }
        }

        /// <summary>Appends a picture of any size: the seed, or later an edit of the scene. Runs on the calling thread.</summary>
        /// <param name="picture">The picture; it is copied.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/>, <see cref="Result.Busy"/>, <see cref="Result.OutOfMemory"/>, <see cref="Result.Device"/>,
        /// <see cref="Result.Cancelled"/>; the rollout is then as it was.
        /// </exception>
        public StepInfo Append(PictureView picture)
        {
            fixed (byte* pixels = &MemoryMarshal.GetReference(picture.Pixels))
            {
                Native.picture native = picture.At(pixels);
                Native.step_info info = EmptyInfo();
                CheckResult(Library.C.rollout_append(Value, &native, &info));
                return new StepInfo(info);
            }
        }

        /// <summary>
        /// Appends four consecutive pictures, the oldest first, as one latent, so that a moving scene keeps moving. Runs on the calling thread.
        /// </summary>
        /// <param name="first">The oldest. All pictures are copied.</param>
        /// <param name="second">The next one.</param>
        /// <param name="third">The next one.</param>
        /// <param name="fourth">The newest.</param>
        /// <exception cref="CairnException">As for <see cref="Append(PictureView)"/>.</exception>
        public StepInfo Append(PictureView first, PictureView second, PictureView third, PictureView fourth)
        {
            fixed (byte* a = &MemoryMarshal.GetReference(first.Pixels))
            fixed (byte* b = &MemoryMarshal.GetReference(second.Pixels))
            fixed (byte* c = &MemoryMarshal.GetReference(third.Pixels))
            fixed (byte* d = &MemoryMarshal.GetReference(fourth.Pixels))
            {
                Native.picture* pictures = stackalloc Native.picture[4];
                pictures[0] = first.At(a);
                pictures[1] = second.At(b);
                pictures[2] = third.At(c);
                pictures[3] = fourth.At(d);
                Native.step_info info = EmptyInfo();
                CheckResult(Library.C.rollout_append_pictures(Value, pictures, 4, &info));
                return new StepInfo(info);
            }
        }

        /// <summary>
        /// Sets whether the encoder keeps its state from one appended picture to the next, as the released engine does, or starts anew for each,
        /// which is the default. The state is empty after this call and after a reset; it is part of a saved state.
        /// </summary>
        /// <param name="keep">True to keep it.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.Unsupported"/> if the bundle's encoder does not take its state as an input; <see cref="Result.Busy"/> while steps are
        /// queued.
        /// </exception>
        public void KeepEncoderStream(bool keep)
        {
            CheckResult(Library.C.rollout_keep_encoder_stream(Value, keep ? 1u : 0u));
        }

        /// <summary>
        /// Releases the device memory of a rollout that pauses: rings, latents and pictures are evicted after the work in flight, and the next
        /// call that needs them makes them resident again. <see cref="Pause"/> does the same for a rollout whose queue was used. Has no effect on a
        /// processor.
        /// </summary>
        /// <exception cref="CairnException"><see cref="Result.Busy"/> while steps are queued; <see cref="Result.Device"/>.</exception>
        public void Rest()
        {
            CheckResult(Library.C.rollout_rest(Value));
        }

        /// <summary>
        /// Makes the next latent; the controls cover one latent's interval of world time. Runs on the calling thread.
        /// </summary>
        /// <param name="controls">Controls of the step.</param>
        /// <exception cref="CairnException">
        /// As for <see cref="Append(PictureView)"/>, and <see cref="Result.Unsupported"/> for a key that the world does not know.
        /// </exception>
        public StepInfo Step(Controls controls = default(Controls))
        {
            Native.controls native = controls.Struct();
            Native.step_info info = EmptyInfo();
            CheckResult(Library.C.rollout_step(Value, &native, &info));
            return new StepInfo(info);
        }

        /// <summary>A copy of the last anchor: its pictures and its latent.</summary>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/> before the first latent; <see cref="Result.Busy"/> while a step is running.
        /// </exception>
        public Anchor Anchor()
        {
            IntPtr anchor = IntPtr.Zero;
            int result = CheckResult(Library.C.rollout_get_anchor(Value, &anchor));
            return new Anchor(CheckCreated(result, ref anchor));
        }

        /// <summary>Returns to the start with the same seed: no latents, empty memory.</summary>
        /// <exception cref="CairnException"><see cref="Result.Busy"/>, <see cref="Result.Device"/>.</exception>
        public void Reset()
        {
            CheckResult(Library.C.rollout_reset(Value));
        }

        /// <summary>
        /// Limits the wall time per latent: latents are made with the first schedule until that takes too long, then with one of fewer passes. This
        /// depends on measured times, so the same controls may give other pictures in another run.
        /// </summary>
        /// <param name="latentNs">Nanoseconds per latent.</param>
        /// <param name="schedules">As in operating points, such as "stock" and "explicit:1:0.5:0"; an empty list ends the limit.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, <see cref="Result.Busy"/>.</exception>
        public void SetBudget(long latentNs, params string[] schedules)
        {
            fixed (byte* list = Text.Encode(string.Join(" ", Check.NotNull(schedules, nameof(schedules))), nameof(schedules)))
            {
                CheckResult(Library.C.rollout_set_budget(Value, Check.NotNegative(latentNs, nameof(latentNs)), list));
            }
        }

        /// <summary>
        /// Keeps the rollout, and the frames of a presenter, within a budget: selects the number of passes per latent, the context window, and how
        /// many of the frames between anchors are made. <see cref="Statistics"/> reports its actions.
        /// </summary>
        /// <param name="budget">The budget; null ends it and keeps the current settings.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/>, <see cref="Result.Busy"/>, <see cref="Result.OutOfMemory"/> if even the narrowest window needs
        /// too much.
        /// </exception>
        public void Govern(Budget budget)
        {
            if (budget == null)
            {
                CheckResult(Library.C.rollout_govern(Value, null));
                return;
            }
            int count = budget.Worlds == null ? 0 : budget.Worlds.Count;
            var worlds = new IntPtr[count];
            for (int i = 0; i < count; i++) worlds[i] = Check.NotNull(budget.Worlds[i], nameof(budget)).Value;
            string list = budget.Schedules == null ? null : string.Join(" ", budget.Schedules);
            fixed (IntPtr* each = worlds)
            fixed (byte* schedules = Text.Encode(list, nameof(budget)))
            {
                var native = new Native.budget
                {
                    struct_size = (uint)sizeof(Native.budget),
                    multiplier = Check.NotNegative(budget.Multiplier, nameof(budget)),
                    frame_ns = Check.NotNegative(budget.FrameNs, nameof(budget)),
                    memory_mib = Check.NotNegative(budget.MemoryMib, nameof(budget)),
                    schedules = schedules,
                    worlds = each,
                    world_count = (uint)count,
                    presenter = budget.Presenter == null ? IntPtr.Zero : budget.Presenter.Value,
                };
                int result = Library.C.rollout_govern(Value, &native);
                GC.KeepAlive(budget);
                CheckResult(result);
            }
        }

        /// <summary>Queues a step for the rollout's own thread, and returns at once. If a step fails, those queued after it are discarded.</summary>
        /// <param name="controls">Controls of the step.</param>
        /// <param name="ticket">Identifies the step for its result.</param>
        /// <returns>False if the queue is full: take results, then try again.</returns>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, <see cref="Result.OutOfMemory"/>.</exception>
        public bool TrySubmit(Controls controls, out long ticket)
        {
            Native.controls native = controls.Struct();
            ulong number = 0;
            int result = CheckResult(Library.C.rollout_submit(Value, &native, &number));
            ticket = (long)number;
            return result == Native.OK;
        }

        /// <summary>Queues the append of a picture, which is copied.</summary>
        /// <param name="picture">See <see cref="Append(PictureView)"/>.</param>
        /// <param name="ticket">Identifies the step for its result.</param>
        /// <returns>False if the queue is full.</returns>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, <see cref="Result.OutOfMemory"/>.</exception>
        public bool TrySubmitPicture(PictureView picture, out long ticket)
        {
            fixed (byte* pixels = &MemoryMarshal.GetReference(picture.Pixels))
            {
                Native.picture native = picture.At(pixels);
                ulong number = 0;
                int result = CheckResult(Library.C.rollout_submit_picture(Value, &native, &number));
                ticket = (long)number;
                return result == Native.OK;
            }
        }

        /// <summary>Queues the append of four pictures, which are copied, as one latent.</summary>
        /// <param name="first">The oldest; see <see cref="Append(PictureView, PictureView, PictureView, PictureView)"/>.</param>
        /// <param name="second">The one after that.</param>
        /// <param name="third">The one after that.</param>
        /// <param name="fourth">The newest.</param>
        /// <param name="ticket">Identifies the step for its result.</param>
        /// <returns>False if the queue is full.</returns>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>, <see cref="Result.OutOfMemory"/>.</exception>
        public bool TrySubmitPictures(
            PictureView first, PictureView second, PictureView third, PictureView fourth, out long ticket)
        {
            fixed (byte* a = &MemoryMarshal.GetReference(first.Pixels))
            fixed (byte* b = &MemoryMarshal.GetReference(second.Pixels))
            fixed (byte* c = &MemoryMarshal.GetReference(third.Pixels))
            fixed (byte* d = &MemoryMarshal.GetReference(fourth.Pixels))
            {
                Native.picture* pictures = stackalloc Native.picture[4];
                pictures[0] = first.At(a);
                pictures[1] = second.At(b);
                pictures[2] = third.At(c);
                pictures[3] = fourth.At(d);
                ulong number = 0;
                int result = CheckResult(Library.C.rollout_submit_pictures(Value, pictures, 4, &number));
                ticket = (long)number;
                return result == Native.OK;
            }
        }

        /// <summary>Takes the result of a queued step without waiting. Each ticket has one result, which can be taken once.</summary>
        /// <param name="ticket">Ticket of the step.</param>
        /// <param name="info">Statistics of the step.</param>
        /// <param name="anchor">The new anchor; close it after use.</param>
        /// <returns>False while the step waits or runs.</returns>
        /// <exception cref="CairnException">
        /// The error of the step; <see cref="Result.InvalidArgument"/> for a ticket whose result was taken.
        /// </exception>
        public bool TryTake(long ticket, out StepInfo info, out Anchor anchor)
        {
            Native.step_info native = EmptyInfo();
            IntPtr made = IntPtr.Zero;
            int result = CheckResult(Library.C.rollout_poll(Value, Check.NotNegative(ticket, nameof(ticket)), &native, &made));
            return ToResult(result, native, made, out info, out anchor);
        }

        /// <summary>As <see cref="TryTake"/>, but waits for the step to end.</summary>
        /// <param name="ticket">Ticket of the step.</param>
        /// <param name="timeout">Maximum wait; <see cref="System.Threading.Timeout.InfiniteTimeSpan"/> for no limit.</param>
        /// <param name="info">Statistics of the step.</param>
        /// <param name="anchor">The new anchor; close it after use.</param>
        /// <returns>False after the timeout.</returns>
        /// <exception cref="CairnException">
        /// As <see cref="TryTake"/>; closing the rollout ends the wait with <see cref="Result.Cancelled"/>.
        /// </exception>
        public bool Wait(long ticket, TimeSpan timeout, out StepInfo info, out Anchor anchor)
        {
            ulong most = Native.FOREVER;
            if (timeout != System.Threading.Timeout.InfiniteTimeSpan)
            {
                if (timeout < TimeSpan.Zero) throw new ArgumentOutOfRangeException(nameof(timeout), timeout, "It must not be negative");
                most = (ulong)timeout.Ticks * 100;
            }
            Native.step_info native = EmptyInfo();
            IntPtr made = IntPtr.Zero;
            int result = CheckResult(Library.C.rollout_wait(Value, Check.NotNegative(ticket, nameof(ticket)), most, &native, &made));
            return ToResult(result, native, made, out info, out anchor);
        }

        /// <summary>
        /// Cancels all work: queued steps are not made, and the running one ends before its next pass. Each fails with
        /// <see cref="Result.Cancelled"/> and leaves the rollout unchanged. Does not wait.
        /// </summary>
        public void Cancel()
        {
            CheckResult(Library.C.rollout_cancel(Value));
        }

        /// <summary>Pauses the queue: the running step finishes, and no other starts.</summary>
        public void Pause()
        {
            CheckResult(Library.C.rollout_pause(Value));
        }

        /// <summary>Resumes a paused queue.</summary>
        public void Resume()
        {
            CheckResult(Library.C.rollout_resume(Value));
        }

        /// <summary>Runs exactly one step of a paused queue.</summary>
        /// <returns>False if every queued step was released already.</returns>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/> if the queue is not paused.</exception>
        public bool SingleStep()
        {
            return CheckResult(Library.C.rollout_single_step(Value)) == Native.OK;
        }

        /// <summary>
        /// Saves the whole state: memory, clocks, seed, operating point and last pictures. A rollout that restores it continues bit for bit.
        /// </summary>
        /// <exception cref="CairnException">
        /// <see cref="Result.Busy"/> while a step is running; <see cref="Result.OutOfMemory"/>, <see cref="Result.Device"/>.
        /// </exception>
        public byte[] Save()
        {
            byte[] state = SavedBy((rollout, bytes, capacity, size) => Library.C.rollout_save(rollout, bytes, capacity, size), Value);
            GC.KeepAlive(this);
            return state;
        }

        /// <summary>
        /// The state, by a function of the library. Its size may change between two calls, if a queued step ends and there is a budget.
        /// </summary>
        internal static byte[] SavedBy(Native.rollout_save_function save, IntPtr rollout)
        {
            const int MostTries = 9;
            UIntPtr size = UIntPtr.Zero;
            CairnException.ThrowIfFailed(save(rollout, null, UIntPtr.Zero, &size));
            for (int attempt = 1; ; attempt++)
            {
                var state = new byte[(long)size];
                try
                {
                    fixed (byte* at = state)
                    {
                        CairnException.ThrowIfFailed(save(rollout, at, (UIntPtr)state.Length, &size));
                    }
                }
                catch (CairnException error) when (error.Result == Result.InvalidArgument && attempt < MostTries)
                {
                    CairnException.ThrowIfFailed(save(rollout, null, UIntPtr.Zero, &size));
                    if ((long)size <= state.Length) throw;
                    continue;
                }
                if ((long)size < state.Length) Array.Resize(ref state, (int)size);
                return state;
            }
        }

        /// <summary>Writes the whole state into a file, completely or not at all.</summary>
        /// <param name="path">An existing file is replaced.</param>
        /// <exception cref="CairnException"><see cref="Result.Io"/>, and as <see cref="Save"/>.</exception>
        public void SaveFile(string path)
        {
            fixed (byte* at = Text.Encode(Check.NotNull(path, nameof(path)), nameof(path)))
            {
                CheckResult(Library.C.rollout_save_file(Value, at));
            }
        }

        /// <summary>Restores a state of the same bundle, precision and global window; seed and operating point become the state's.</summary>
        /// <param name="state">Result of <see cref="Save"/>.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidState"/>, <see cref="Result.Unsupported"/> for a state of another version, <see cref="Result.Busy"/>,
        /// <see cref="Result.Device"/>; the rollout is then as it was.
        /// </exception>
        public void Restore(ReadOnlySpan<byte> state)
        {
            fixed (byte* at = &MemoryMarshal.GetReference(state))
            {
                CheckResult(Library.C.rollout_restore(Value, at, (UIntPtr)state.Length));
            }
        }

        /// <summary>Restores a state from a file.</summary>
        /// <param name="path">Path of the file.</param>
        /// <exception cref="CairnException"><see cref="Result.Io"/>, and as <see cref="Restore"/>.</exception>
        public void RestoreFile(string path)
        {
            fixed (byte* at = Text.Encode(Check.NotNull(path, nameof(path)), nameof(path)))
            {
                CheckResult(Library.C.rollout_restore_file(Value, at));
            }
        }

        private static Native.step_info EmptyInfo()
        {
            return new Native.step_info { struct_size = (uint)sizeof(Native.step_info) };
        }

        private static bool ToResult(int result, Native.step_info native, IntPtr made, out StepInfo info, out Anchor anchor)
        {
            bool taken = result == Native.OK;
            info = new StepInfo(native);
            anchor = taken ? new Anchor(made) : null;
            return taken;
        }
    }
}
