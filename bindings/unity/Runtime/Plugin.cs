using System;
using System.Runtime.InteropServices;
using System.Text;
using UnityEngine.Rendering;

namespace Cairn.Unity
{
    /// <summary>The native plugin: its functions beyond the C interface, and whether it can draw.</summary>
    public static unsafe class Plugin
    {
        private static bool isLoaded;

        /// <summary>Whether frames can be shown. From any thread.</summary>
        /// <param name="what">Name of Unity's interface; otherwise the reason and a remedy.</param>
        public static bool IsReady(out string what)
        {
            try
            {
                uint version = Native.cairn_unity_version();
                if (version != Native.Version)
                {
                    what = $"{Native.Name}.dll has entry points of version {version}; these scripts need {Native.Version}. Take both from one package.";
                    return false;
                }
                int result = Native.cairn_unity_state(null, UIntPtr.Zero, null);
                what = ReadText((byte* text, UIntPtr room, UIntPtr* length) => Native.cairn_unity_state(text, room, length));
                return result == 0;
            }
            catch (DllNotFoundException)
            {
                what = $"{Native.Name}.dll is missing, or what it needs is. It is a part of this package, in Plugins/x86_64, and made for "
                    + "Windows on x86-64.";
            }
            catch (EntryPointNotFoundException)
            {
                what = $"{Native.Name}.dll is another library, or an older one. Take scripts and library from one package.";
            }
            catch (BadImageFormatException)
            {
                what = $"{Native.Name}.dll is made for Windows on x86-64, and this process is another one.";
            }
            return false;
        }

        /// <summary>Makes a Cairn device on Unity's own. Takes a while, so call it off the main thread.</summary>
        /// <exception cref="CairnException">
        /// <see cref="Result.Unsupported"/> if <see cref="IsReady"/> is false; <see cref="Result.RuntimeMissing"/> if ONNX Runtime is not beside
        /// the library.
        /// </exception>
        public static Device CreateDevice()
        {
            string why;
            if (!IsReady(out why)) throw new CairnException(Result.Unsupported, why, "cairn_unity_create_device", "", why, "");
            Load();
            IntPtr device = IntPtr.Zero;
            CairnException.ThrowIfFailed(Native.cairn_unity_create_device(&device));
            return new Device(device);
        }

        /// <summary>
        /// Makes the classes of the namespace <c>Cairn</c> use the library that Unity has loaded, and no other. Components call this; a script
        /// that uses the classes without components must call it first.
        /// </summary>
        /// <exception cref="CairnException">The library and these scripts are of different packages.</exception>
        /// <exception cref="InvalidOperationException">The process uses another file already.</exception>
        public static void Load()
        {
            if (isLoaded) return;
            Library.Load(ReadText((byte* text, UIntPtr room, UIntPtr* length) => Native.cairn_unity_path(text, room, length)));
            isLoaded = true;
        }

        /// <summary>
        /// Creates everything that a presenter needs for frames of a size, from anchors of a size. Takes seconds the first time, so call it on a
        /// loading thread. Until then, and in another size, the nearest anchor is shown. Compiled pipelines are kept in the file
        /// <paramref name="pipelines"/> for the next run.
        /// </summary>
        /// <exception cref="CairnException">For example for a required generator that is not available, or too little memory.</exception>
        internal static void Prepare(
            Device device, Presenter presenter, int width, int height, int anchorWidth, int anchorHeight, string pipelines)
        {
            int result;
            fixed (byte* file = Encoding.UTF8.GetBytes(pipelines + "\0"))
            {
                result = Native.cairn_unity_prepare(
                    device.Value, presenter.Value, (uint)width, (uint)height, (uint)anchorWidth, (uint)anchorHeight, file);
            }
            CairnException.ThrowIfFailed(result);
            GC.KeepAlive(device);
            GC.KeepAlive(presenter);
        }

        private delegate int TextFunction(byte* text, UIntPtr room, UIntPtr* length);

        private static string ReadText(TextFunction function)
        {
            UIntPtr length = UIntPtr.Zero;
            function(null, UIntPtr.Zero, &length);
            var room = new byte[(int)length + 1];
            fixed (byte* text = room) function(text, (UIntPtr)room.Length, &length);
            // The message may have changed between the two calls.
            return Encoding.UTF8.GetString(room, 0, Math.Min((int)length, room.Length - 1));
        }

        /// <summary>A presenter's frames in a texture of Unity's.</summary>
        internal sealed class View : IDisposable
        {
            private readonly CairnObject device;
            private readonly CairnObject presenter;
            // Reused in every frame.
            private readonly byte[] message = new byte[1024];
            private IntPtr view;

            internal View(Device device, Presenter presenter)
            {
                this.device = device;
                this.presenter = presenter;
                IntPtr made = IntPtr.Zero;
                int result = Native.cairn_unity_view_create(device.Value, presenter.Value, &made);
                if (result != 0) throw Failed(result, "cairn_unity_view_create", "device or presenter is closed");
                view = made;
            }

            /// <summary>Sets time and texture of the next events.</summary>
            internal void Set(long nowNs, IntPtr texture)
            {
                int result = Native.cairn_unity_view_set(view, (ulong)nowNs, texture);
                if (result != 0) throw Failed(result, "cairn_unity_view_set", "the texture is no ID3D12Resource");
            }

            /// <summary>Records both events.</summary>
            internal void Issue(CommandBuffer commands)
            {
                IntPtr function = Native.cairn_unity_get_event_function();
                commands.IssuePluginEventAndData(function, Native.cairn_unity_get_make_event(), view);
                commands.IssuePluginEventAndData(function, Native.cairn_unity_get_show_event(), view);
            }

            /// <summary>Number of frames shown; false if the last event failed, with the reason.</summary>
            internal bool TryGetShown(out long shown, out string why)
            {
                ulong frames = 0;
                UIntPtr length = UIntPtr.Zero;
                int result;
                fixed (byte* text = message)
                {
                    result = Native.cairn_unity_view_get(view, &frames, null, text, (UIntPtr)message.Length, &length);
                }
                shown = (long)frames;
                why = result < 0 ? Encoding.UTF8.GetString(message, 0, Math.Min((int)length, message.Length - 1)) : "";
                return result >= 0;
            }

            public void Dispose()
            {
                if (view == IntPtr.Zero) return;
                Native.cairn_unity_view_destroy(view);
                view = IntPtr.Zero;
                GC.KeepAlive(device);
                GC.KeepAlive(presenter);
            }

            private static CairnException Failed(int result, string function, string why)
            {
                return new CairnException((Result)result, $"{function}: {why}", function, "", why, "");
            }
        }

        /// <summary>The plugin's own functions, by their exported names.</summary>
        private static class Native
        {
            internal const string Name = "cairn_unity";
            internal const uint Version = 4;

            [DllImport(Name)]
            internal static extern uint cairn_unity_version();

            [DllImport(Name)]
            internal static extern int cairn_unity_state(byte* text, UIntPtr capacity, UIntPtr* length);

            [DllImport(Name)]
            internal static extern int cairn_unity_path(byte* text, UIntPtr capacity, UIntPtr* length);

            [DllImport(Name)]
            internal static extern int cairn_unity_create_device(IntPtr* device);

            [DllImport(Name)]
            internal static extern int cairn_unity_prepare(
                IntPtr device, IntPtr presenter, uint width, uint height, uint anchorWidth, uint anchorHeight, byte* pipelines);

            [DllImport(Name)]
            internal static extern int cairn_unity_view_create(IntPtr device, IntPtr presenter, IntPtr* view);

            [DllImport(Name)]
            internal static extern int cairn_unity_view_set(IntPtr view, ulong nowNs, IntPtr texture);

            [DllImport(Name)]
            internal static extern int cairn_unity_view_get(
                IntPtr view, ulong* shown, void* frame, byte* text, UIntPtr capacity, UIntPtr* length);

            [DllImport(Name)]
            internal static extern int cairn_unity_view_destroy(IntPtr view);

            [DllImport(Name)]
            internal static extern IntPtr cairn_unity_get_event_function();

            [DllImport(Name)]
            internal static extern int cairn_unity_get_make_event();

            [DllImport(Name)]
            internal static extern int cairn_unity_get_show_event();
        }
    }
}
