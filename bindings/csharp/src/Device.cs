using System;
using System.Collections.Generic;
using System.Runtime.ExceptionServices;
using System.Runtime.InteropServices;

namespace Cairn
{
    /// <summary>Kinds of devices.</summary>
    public enum DeviceKind
    {
        /// <summary>The host's processor, through ONNX Runtime's CPU provider.</summary>
        Cpu = Native.DEVICE_CPU,
        /// <summary>A Direct3D 12 adapter, through ONNX Runtime's DirectML provider.</summary>
        D3d12 = Native.DEVICE_D3D12,
        /// <summary>A graphics adapter, through ONNX Runtime's WebGPU provider.</summary>
        WebGpu = Native.DEVICE_WEBGPU,
    }

    /// <summary>Numeric precision of the graphs.</summary>
    public enum Precision
    {
        /// <summary>The device's preferred precision.</summary>
        Best = 0,
        /// <summary>Float32.</summary>
        F32 = Native.PRECISION_F32,
        /// <summary>Float16.</summary>
        F16 = Native.PRECISION_F16,
    }

    /// <summary>Requirements of a device; a newer library may have more.</summary>
    public enum RequirementKind
    {
        /// <summary>The operating system and the build of the library.</summary>
        Platform = Native.REQUIREMENT_PLATFORM,
        /// <summary>ONNX Runtime's library.</summary>
        OnnxRuntime = Native.REQUIREMENT_ONNXRUNTIME,
        /// <summary>Memory of the system.</summary>
        Memory = Native.REQUIREMENT_MEMORY,
        /// <summary>AMD's libraries for FSR, one for each file that was found.</summary>
        FsrLibraries = Native.REQUIREMENT_FSR_LIBRARIES,
        /// <summary>A provider of FSR frame generation for the first adapter.</summary>
        FsrProvider = Native.REQUIREMENT_FSR_PROVIDER,
        /// <summary>The system's build number, for FSR.</summary>
        FsrSystem = Native.REQUIREMENT_FSR_SYSTEM,
        /// <summary>Direct3D 12's library, for FSR.</summary>
        FsrDirect3d = Native.REQUIREMENT_FSR_DIRECT3D,
        /// <summary>The shader model of the first adapter, for FSR.</summary>
        FsrShaderModel = Native.REQUIREMENT_FSR_SHADER_MODEL,
        /// <summary>The library's own shaders on the first adapter, for frame generation.</summary>
        Shaders = Native.REQUIREMENT_SHADERS,
        /// <summary>The library of ONNX Runtime's WebGPU provider.</summary>
        WebGpu = Native.REQUIREMENT_WEBGPU,
        /// <summary>A graphics adapter for the WebGPU provider.</summary>
        Adapter = Native.REQUIREMENT_ADAPTER,
    }

    /// <summary>Whether a requirement is met.</summary>
    public enum RequirementStatus
    {
        /// <summary>It is met.</summary>
        Met = Native.REQUIREMENT_MET,
        /// <summary>It is not met, and the device cannot be made.</summary>
        NotMet = Native.REQUIREMENT_NOT_MET,
        /// <summary>Whether it is met depends on the world, or the system does not report it.</summary>
        Unknown = Native.REQUIREMENT_UNKNOWN,
        /// <summary>It is not met, and a device can be made without it.</summary>
        Optional = Native.REQUIREMENT_OPTIONAL,
    }

    /// <summary>An adapter or processor from which a device can be made.</summary>
    public sealed unsafe class Adapter
    {
        internal Adapter(ref Native.adapter from)
        {
            Kind = (DeviceKind)from.kind;
            Index = (int)from.index;
            Luid = from.luid;
            Memory = (long)from.memory;
            fixed (byte* name = from.name) Name = Text.Decode(name, 128);
        }

        /// <summary>Kind of device.</summary>
        public DeviceKind Kind { get; }

        /// <summary>Index among those of its kind.</summary>
        public int Index { get; }

        /// <summary>Name for display.</summary>
        public string Name { get; }

        /// <summary>Bytes of its own memory or, for the processor, of the system's. 0 if unknown.</summary>
        public long Memory { get; }

        /// <summary>The LUID of a Direct3D 12 adapter, low part first; else 0.</summary>
        public ulong Luid { get; }
    }

    /// <summary>A requirement of a device.</summary>
    public sealed unsafe class Requirement
    {
        internal Requirement(ref Native.requirement from)
        {
            Kind = (RequirementKind)from.what;
            Status = (RequirementStatus)from.status;
            fixed (byte* needed = from.needed) Needed = Text.Decode(needed, 96);
            fixed (byte* found = from.found) Found = Text.Decode(found, 512);
        }

        /// <summary>Kind of requirement.</summary>
        public RequirementKind Kind { get; }

        /// <summary>Whether it is met.</summary>
        public RequirementStatus Status { get; }

        /// <summary>The requirement as text.</summary>
        public string Needed { get; }

        /// <summary>What was found.</summary>
        public string Found { get; }
    }

    /// <summary>
    /// Settings of a device, and paths of the libraries it needs. Defaults: one thread per physical core, and libraries beside Cairn's
    /// or beside the program.
    /// </summary>
    public sealed class DeviceOptions
    {
        /// <summary>
        /// Threads that share one pass, 1 to 1024; 0 for one per physical core. The last bits of a rollout depend on it.
        /// </summary>
        public int Threads { get; set; }

        /// <summary>Use only deterministic kernels of ONNX Runtime.</summary>
        public bool Deterministic { get; set; }

        /// <summary>
        /// Lets environment variables and the user's cache directory name libraries that are loaded into the process. For tools: in a game,
        /// anyone who sets its environment variables could run code in it.
        /// </summary>
        public bool Environment { get; set; }

        /// <summary>
        /// Path of ONNX Runtime 1.24 or newer (tested: 1.24.4 and 1.32.0); a Direct3D 12 device needs the build with DirectML, 1.24.4.
        /// Null: the first one beside Cairn's library or beside the program; with <see cref="Environment"/> also
        /// in the user's cache directory, or if the variable CAIRN_ONNXRUNTIME is set, only the file that it names.
        /// </summary>
        public string OnnxRuntime { get; set; }

        /// <summary>
        /// Folder of AMD's libraries for FSR. Null: beside Cairn's library, then beside the program; with <see cref="Environment"/>, if the
        /// variable CAIRN_FFX_DIR is set, only the folder that it names.
        /// </summary>
        public string Ffx { get; set; }

        /// <summary>
        /// Path of the library of ONNX Runtime's WebGPU provider, for <see cref="Device.Gpu"/>. Null: beside ONNX Runtime's; with
        /// <see cref="Environment"/>, if the variable CAIRN_WEBGPU is set, the file that it names.
        /// </summary>
        public string WebGpu { get; set; }
    }

    /// <summary>Properties of a device.</summary>
    public sealed unsafe class DeviceInfo
    {
        internal DeviceInfo(ref Native.device_info from)
        {
            Kind = (DeviceKind)from.kind;
            Precision = (Precision)from.precision;
            Threads = (int)from.threads;
            MemoryBudgetMib = (int)from.memory_budget_mib;
            MemoryUsedMib = (int)from.memory_used_mib;
            fixed (byte* description = from.description) Description = Text.Decode(description, 128);
        }

        /// <summary>Kind of device.</summary>
        public DeviceKind Kind { get; }

        /// <summary>Default precision.</summary>
        public Precision Precision { get; }

        /// <summary>Threads that share one pass.</summary>
        public int Threads { get; }

        /// <summary>Description, such as "ONNX Runtime 1.24.4 CPU, 8 threads".</summary>
        public string Description { get; }

        /// <summary>MiB of its adapter's memory that the system grants to the process now; 0 if unknown.</summary>
        public int MemoryBudgetMib { get; }

        /// <summary>MiB of its adapter's memory that the whole process uses.</summary>
        public int MemoryUsedMib { get; }
    }

    /// <summary>A stage of loading a world.</summary>
    public enum LoadStage
    {
        /// <summary>Reads and checks files; progress counts bytes.</summary>
        Reading = Native.LOAD_READING,
        /// <summary>ONNX Runtime prepares the graphs; progress counts graphs.</summary>
        Preparing = Native.LOAD_PREPARING,
    }

    /// <summary>Called with the progress on the loading thread; returning false ends the load with <see cref="Result.Cancelled"/>.</summary>
    /// <param name="stage">Current stage.</param>
    /// <param name="done">Bytes or graphs of the stage that are done.</param>
    /// <param name="total">Their total.</param>
    public delegate bool LoadProgress(LoadStage stage, long done, long total);

    /// <summary>Selects a world and how it is loaded. Default: the embedded world.</summary>
    public sealed class WorldOptions
    {
        /// <summary>The bundle, a folder or a file; null for the world inside the library.</summary>
        public string Path { get; set; }

        /// <summary>
        /// Operating point: a preset with changes after commas, such as "coherence" or "stock,g64,native". Null for "stock" at the bundle's
        /// own window.
        /// </summary>
        public string OperatingPoint { get; set; }

        /// <summary>Precision of the graphs.</summary>
        public Precision Precision { get; set; }

        /// <summary>Limit in bytes for the world with one rollout; 0 for the memory that the system has available.</summary>
        public long MemoryLimit { get; set; }

        /// <summary>Narrows the global window if it does not fit the memory, instead of failing.</summary>
        public bool FitWindow { get; set; }

        /// <summary>
        /// For graphs in F16: makes one latent in F32 as well, and fails if F16 is not enough for the bundle on this device. Needs about twice the
        /// memory of the F16 graphs' weights for a while; one load of a bundle and a device needs it.
        /// </summary>
        public bool CheckPrecision { get; set; }

        /// <summary>
        /// Slices of the transformer, 1 to the number of its layers: graphs of consecutive layers that run one after the other, so that an engine's
        /// frame gets its turn between them. On the processor every number gives the same bits in F32; more need more memory. 0 for 1, or with
        /// <see cref="LongestSubmissionUs"/> for as many as that limit needs.
        /// </summary>
        public int Slices { get; set; }

        /// <summary>
        /// Limit on the time of a slice in microseconds; 0 for none. Without <see cref="Slices"/> passes are measured at load, which takes several times
        /// as long then. On Direct3D 12 a rollout also waits before it submits more work than this.
        /// </summary>
        public int LongestSubmissionUs { get; set; }

        /// <summary>Progress callback, which may end the load; an exception from it ends it too. May be null.</summary>
        public LoadProgress Progress { get; set; }
    }

    /// <summary>A device that runs worlds. May be used from any thread.</summary>
    public sealed unsafe class Device : CairnObject
    {
        private static readonly Native.load_callback Callback = OnProgress;
        private static readonly IntPtr CallbackAddress = Marshal.GetFunctionPointerForDelegate(Callback);

        internal Device(IntPtr value) : base(value, handle => Library.C.device_destroy(handle))
        {
        }

        /// <summary>Makes a device from this machine's processor; loads ONNX Runtime.</summary>
        /// <param name="options">Settings; null for the defaults.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.RuntimeMissing"/> if ONNX Runtime is missing, too old or faulty; <see cref="Result.Unsupported"/> if the
        /// process already uses another file of it; <see cref="Result.InvalidArgument"/>; <see cref="Result.Device"/>.
        /// </exception>
        public static Device Cpu(DeviceOptions options = null)
        {
            options = options ?? new DeviceOptions();
            fixed (byte* onnxruntime = Text.Encode(options.OnnxRuntime, nameof(options)))
            fixed (byte* ffx = Text.Encode(options.Ffx, nameof(options)))
            {
                Native.device_options native = Of(options, onnxruntime, ffx);
                IntPtr device = IntPtr.Zero;
                return new Device(CheckCreated(Library.C.device_create_cpu(&native, &device), ref device));
            }
        }

        /// <summary>
        /// Makes a device from a graphics adapter, through ONNX Runtime's WebGPU provider, whose library must be beside ONNX Runtime's.
        /// Experimental.
        /// </summary>
        /// <param name="adapter">
        /// A part of the adapter's name, its vendor such as "0x1002", or its number among those that Vulkan lists; null for the fastest, and on
        /// Windows. An adapter that the processor emulates is used only if it is named.
        /// </param>
        /// <param name="options">Settings; null for the defaults.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.RuntimeMissing"/> if ONNX Runtime or the provider's library is missing; <see cref="Result.Unsupported"/> if there
        /// is no such adapter, the process already uses another one, or the library is of another version than this assembly;
        /// <see cref="Result.InvalidArgument"/>; <see cref="Result.Device"/>.
        /// </exception>
        public static Device Gpu(string adapter = null, DeviceOptions options = null)
        {
            options = options ?? new DeviceOptions();
            fixed (byte* name = Text.Encode(adapter, nameof(adapter)))
            fixed (byte* onnxruntime = Text.Encode(options.OnnxRuntime, nameof(options)))
            fixed (byte* ffx = Text.Encode(options.Ffx, nameof(options)))
            fixed (byte* webgpu = Text.Encode(options.WebGpu, nameof(options)))
            {
                Native.device_options native = Of(options, onnxruntime, ffx);
                native.webgpu = webgpu;
                IntPtr device = IntPtr.Zero;
                return new Device(CheckCreated(Library.C.device_create_gpu(name, &native, &device), ref device));
            }
        }

        /// <summary>
        /// Makes the best device of this machine: on Windows from the first Direct3D 12 adapter, else as <see cref="Gpu"/> with no adapter
        /// named, else as <see cref="Cpu"/>. Experimental.
        /// </summary>
        /// <param name="refusals">A line for each better kind that was not taken, with the reason, for people.</param>
        /// <param name="options">Settings; null for the defaults.</param>
        /// <exception cref="CairnException">
        /// As <see cref="Cpu"/>, and <see cref="Result.Unsupported"/> if the library is of another version than this assembly.
        /// </exception>
        public static Device Auto(out string refusals, DeviceOptions options = null)
        {
            // The call cannot be repeated for a longer text.
            var room = new byte[1 << 16];
            options = options ?? new DeviceOptions();
            fixed (byte* text = room)
            fixed (byte* onnxruntime = Text.Encode(options.OnnxRuntime, nameof(options)))
            fixed (byte* ffx = Text.Encode(options.Ffx, nameof(options)))
            fixed (byte* webgpu = Text.Encode(options.WebGpu, nameof(options)))
            {
                Native.device_options native = Of(options, onnxruntime, ffx);
                native.webgpu = webgpu;
                IntPtr device = IntPtr.Zero;
                int result = Library.C.device_create_auto(&native, text, (UIntPtr)room.Length, null, &device);
                var made = new Device(CheckCreated(result, ref device));
                refusals = Text.Decode(text, room.Length);
                return made;
            }
        }

        /// <summary>Lists available devices: the processor always, Direct3D 12 adapters on Windows, and Vulkan's adapters on Linux.</summary>
        public static IReadOnlyList<Adapter> Adapters()
        {
            Native.Functions c = Library.C;
            uint count = 0;
            CairnException.ThrowIfFailed(c.adapters(null, (UIntPtr)sizeof(Native.adapter), 0, &count));
            while (true)
            {
                // The second call may return more entries than the first.
                var room = new Native.adapter[count];
                for (int i = 0; i < room.Length; i++) room[i].struct_size = (uint)sizeof(Native.adapter);
                fixed (Native.adapter* at = room)
                {
                    CairnException.ThrowIfFailed(c.adapters(at, (UIntPtr)sizeof(Native.adapter), (uint)room.Length, &count));
                }
                if (count > room.Length) continue;
                var found = new Adapter[count];
                for (int i = 0; i < found.Length; i++) found[i] = new Adapter(ref room[i]);
                return found;
            }
        }

        /// <summary>Lists the requirements of a kind of device and what was found, for example to show to a player.</summary>
        /// <param name="kind">Kind of device.</param>
        /// <param name="options">Settings that the device would have; may be null.</param>
        /// <exception cref="CairnException"><see cref="Result.InvalidArgument"/>; an unmet requirement is not an error.</exception>
        public static IReadOnlyList<Requirement> Requirements(DeviceKind kind = DeviceKind.Cpu, DeviceOptions options = null)
        {
            options = options ?? new DeviceOptions();
            Native.Functions c = Library.C;
            fixed (byte* onnxruntime = Text.Encode(options.OnnxRuntime, nameof(options)))
            fixed (byte* ffx = Text.Encode(options.Ffx, nameof(options)))
            fixed (byte* webgpu = Text.Encode(options.WebGpu, nameof(options)))
            {
                Native.device_options native = Of(options, onnxruntime, ffx);
                native.webgpu = webgpu;
                var stride = (UIntPtr)sizeof(Native.requirement);
                uint count = 0;
                CairnException.ThrowIfFailed(c.device_requirements((uint)kind, &native, null, stride, 0, &count));
                while (true)
                {
                    var room = new Native.requirement[count];
                    for (int i = 0; i < room.Length; i++) room[i].struct_size = (uint)sizeof(Native.requirement);
                    fixed (Native.requirement* at = room)
                    {
                        CairnException.ThrowIfFailed(c.device_requirements((uint)kind, &native, at, stride, (uint)room.Length, &count));
                    }
                    if (count > room.Length) continue;
                    var found = new Requirement[count];
                    for (int i = 0; i < found.Length; i++) found[i] = new Requirement(ref room[i]);
                    return found;
                }
            }
        }

        /// <summary>Properties.</summary>
        public DeviceInfo Info
        {
            get
            {
                var native = new Native.device_info { struct_size = (uint)sizeof(Native.device_info) };
                CheckResult(Library.C.device_get_info(Value, &native));
                return new DeviceInfo(ref native);
            }
        }

        /// <summary>
        /// Loads a world: reads and checks the bundle, compares its memory needs with the available memory, and prepares its graphs. Takes
        /// seconds to minutes with real weights, so do not call it on the render thread.
        /// </summary>
        /// <param name="options">Selects the world; null for the embedded one.</param>
        /// <exception cref="CairnException">
        /// <see cref="Result.InvalidArgument"/>, <see cref="Result.Io"/>, <see cref="Result.InvalidBundle"/>,
        /// <see cref="Result.Unsupported"/>, <see cref="Result.OutOfMemory"/> with the numbers, <see cref="Result.Device"/>;
        /// <see cref="Result.Cancelled"/> if the progress callback returned false. An exception in that callback is rethrown unchanged.
        /// </exception>
        public World LoadWorld(WorldOptions options = null)
        {
            options = options ?? new WorldOptions();
            var load = new Load { Progress = options.Progress };
            GCHandle user = GCHandle.Alloc(load);
            try
            {
                fixed (byte* path = Text.Encode(options.Path, nameof(options)))
                fixed (byte* operatingPoint = Text.Encode(options.OperatingPoint, nameof(options)))
                {
                    var native = new Native.world_options
                    {
                        struct_size = (uint)sizeof(Native.world_options),
                        precision = (uint)options.Precision,
                        path = path,
                        operating_point = operatingPoint,
                        memory_limit = Check.NotNegative(options.MemoryLimit, nameof(options)),
                        progress = options.Progress == null ? IntPtr.Zero : CallbackAddress,
                        user = (void*)GCHandle.ToIntPtr(user),
                        flags = (options.FitWindow ? (uint)Native.WORLD_FIT_WINDOW : 0)
                            | (options.CheckPrecision ? (uint)Native.WORLD_CHECK_PRECISION : 0),
                        slices = Check.NotNegative(options.Slices, nameof(options)),
                        longest_submission_us = Check.NotNegative(options.LongestSubmissionUs, nameof(options)),
                    };
                    IntPtr world = IntPtr.Zero;
                    int result = Library.C.world_load(Value, &native, &world);
                    GC.KeepAlive(this);
                    // An exception must not pass through the library; it is thrown again after the call.
                    if (load.Thrown != null) load.Thrown.Throw();
                    return new World(CheckCreated(result, ref world));
                }
            }
            finally
            {
                user.Free();
            }
        }

        private static Native.device_options Of(DeviceOptions options, byte* onnxruntime, byte* ffx)
        {
            int flags = (options.Deterministic ? Native.DEVICE_DETERMINISTIC : 0) | (options.Environment ? Native.DEVICE_ENVIRONMENT : 0);
            return new Native.device_options
            {
                struct_size = (uint)sizeof(Native.device_options),
                threads = Check.NotNegative(options.Threads, nameof(options)),
                flags = (uint)flags,
                onnxruntime = onnxruntime,
                ffx = ffx,
            };
        }

        [MonoPInvokeCallback(typeof(Native.load_callback))]
        private static uint OnProgress(Native.load_progress* progress, void* user)
        {
            var load = (Load)GCHandle.FromIntPtr((IntPtr)user).Target;
            try
            {
                return load.Progress((LoadStage)progress->stage, (long)progress->done, (long)progress->total) ? 0u : 1u;
            }
            catch (Exception why)
            {
                load.Thrown = ExceptionDispatchInfo.Capture(why);
                return 1;
            }
        }

        /// <summary>State of a load's callback, with the exception it threw.</summary>
        private sealed class Load
        {
            internal LoadProgress Progress;
            internal ExceptionDispatchInfo Thrown;
        }
    }
}
