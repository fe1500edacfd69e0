// The parts of Unity's engine that the package uses, so that it compiles without Unity. Names and types are those of Unity's manual. Input, the
// components of an object and textures are implemented as far as the tests of the components need them.

using System;
using System.Collections.Generic;
using System.Linq;
using Cairn.Unity.Tests;

namespace Cairn.Unity.Tests
{
    /// <summary>State of the engine that the classes below return. Tests set it.</summary>
    public static class EngineDouble
    {
        /// <summary>Names of the keys that are held, in either input system.</summary>
        public static readonly HashSet<string> Held = new HashSet<string>();

        /// <summary>Names of the keys that went down since the last frame, whether or not they are still held.</summary>
        public static readonly HashSet<string> Tapped = new HashSet<string>();

        internal static bool WasPressed(string name)
        {
            return Tapped.Contains(name) && (TellsOfTaps || Held.Contains(name));
        }

        /// <summary>Whether the Input System, as since its version 1.9, tells that a key went down that is up again.</summary>
        public static bool TellsOfTaps = true;

        /// <summary>Movement of the mouse in the current frame, in pixels.</summary>
        public static UnityEngine.Vector2 Mouse;

        /// <summary>Movement of the wheel in the current frame.</summary>
        public static float Wheel;

        /// <summary>Components beside every component.</summary>
        public static readonly List<UnityEngine.Component> Components = new List<UnityEngine.Component>();
    }
}

namespace UnityEngine
{
    public class Object
    {
        public string name { get; set; }

        public static void Destroy(Object gone)
        {
        }

        public static bool operator ==(Object one, Object other)
        {
            return ReferenceEquals(one, other);
        }

        public static bool operator !=(Object one, Object other)
        {
            return !ReferenceEquals(one, other);
        }

        public override bool Equals(object other)
        {
            return ReferenceEquals(this, other);
        }

        public override int GetHashCode()
        {
            return 0;
        }
    }

    public class Component : Object
    {
        public T GetComponent<T>()
        {
            return EngineDouble.Components.OfType<T>().FirstOrDefault();
        }
    }

    public class Behaviour : Component
    {
    }

    // Not used by the package: a game's scripts use it beside the namespace Cairn.
    public sealed class Camera : Behaviour
    {
    }

    public class MonoBehaviour : Behaviour
    {
    }

    public sealed class GameObject : Object
    {
        public GameObject(string name)
        {
            this.name = name;
        }

        public void SetActive(bool active)
        {
        }

        public T AddComponent<T>() where T : Component
        {
            return default(T);
        }
    }

    public class Texture : Object
    {
        public virtual int width { get; set; }

        public virtual int height { get; set; }

        public virtual bool isReadable
        {
            get { return true; }
        }

        public FilterMode filterMode { get; set; }

        public IntPtr GetNativeTexturePtr()
        {
            return IntPtr.Zero;
        }
    }

    public sealed class Texture2D : Texture
    {
        public Color32[] GetPixels32()
        {
            return new Color32[0];
        }
    }

    public class RenderTexture : Texture
    {
        public RenderTexture(int width, int height, int depth, RenderTextureFormat format, RenderTextureReadWrite readWrite)
        {
            this.width = width;
            this.height = height;
            this.format = format;
        }

        public RenderTextureFormat format { get; set; }

        public bool useMipMap { get; set; }

        public int antiAliasing { get; set; }

        public bool Create()
        {
            return true;
        }

        public bool IsCreated()
        {
            return true;
        }

        public void Release()
        {
        }
    }

    public class Material : Object
    {
        public Texture mainTexture { get; set; }

        public Vector2 mainTextureScale { get; set; }

        public Vector2 mainTextureOffset { get; set; }
    }

    public class Renderer : Component
    {
        public Material material { get; set; }
    }

    public class TextAsset : Object
    {
        public byte[] bytes
        {
            get { return new byte[0]; }
        }
    }

    public enum FilterMode
    {
        Point, Bilinear, Trilinear,
    }

    public enum RenderTextureFormat
    {
        ARGB32, ARGBHalf, RGB111110Float,
    }

    public enum ColorSpace
    {
        Gamma, Linear,
    }

    public static class QualitySettings
    {
        public static ColorSpace activeColorSpace
        {
            get { return ColorSpace.Linear; }
        }
    }

    public static class SystemInfo
    {
        public static bool SupportsRenderTextureFormat(RenderTextureFormat format)
        {
            return true;
        }
    }

    public enum RenderTextureReadWrite
    {
        Default, Linear, sRGB,
    }

    public struct Color32
    {
        public byte r;
        public byte g;
        public byte b;
        public byte a;

        public Color32(byte r, byte g, byte b, byte a)
        {
            this.r = r;
            this.g = g;
            this.b = b;
            this.a = a;
        }
    }

    public struct Vector2
    {
        public float x;
        public float y;

        public Vector2(float x, float y)
        {
            this.x = x;
            this.y = y;
        }

        public static Vector2 zero
        {
            get { return new Vector2(0, 0); }
        }

        public static Vector2 operator +(Vector2 one, Vector2 other)
        {
            return new Vector2(one.x + other.x, one.y + other.y);
        }

        public static Vector2 operator *(Vector2 one, float by)
        {
            return new Vector2(one.x * by, one.y * by);
        }
    }

    public struct Rect
    {
        public Rect(float x, float y, float width, float height)
        {
            this.x = x;
            this.y = y;
            this.width = width;
            this.height = height;
        }

        public float x { get; set; }

        public float y { get; set; }

        public float width { get; set; }

        public float height { get; set; }

        public Vector2 position
        {
            get { return new Vector2(x, y); }
        }

        public Vector2 size
        {
            get { return new Vector2(width, height); }
        }
    }

    public struct Mathf
    {
        public static float Min(float one, float other)
        {
            return Math.Min(one, other);
        }

        public static float Clamp(float value, float min, float max)
        {
            return value < min ? min : value > max ? max : value;
        }
    }

    public static class Debug
    {
        public static void Log(object message)
        {
        }

        public static void LogError(object message)
        {
            Console.Error.WriteLine(message);
        }

        public static void LogError(object message, Object context)
        {
            LogError(message);
        }
    }

    public static class Application
    {
        public static bool isPlaying
        {
            get { return false; }
        }

        public static string persistentDataPath
        {
            get { return ""; }
        }

        public static string streamingAssetsPath
        {
            get { return ""; }
        }
    }

    public static class Screen
    {
        public static int width
        {
            get { return 0; }
        }

        public static int height
        {
            get { return 0; }
        }
    }

    public static class Cursor
    {
        public static CursorLockMode lockState { get; set; }
    }

    public enum CursorLockMode
    {
        None, Locked, Confined,
    }

    public static class Graphics
    {
        public static void ExecuteCommandBuffer(Rendering.CommandBuffer buffer)
        {
        }
    }

    public sealed class Event
    {
        public static Event current
        {
            get { return null; }
        }

        public EventType type
        {
            get { return EventType.Layout; }
        }
    }

    public enum EventType
    {
        MouseDown, Repaint = 7, Layout = 8,
    }

    public class GUIContent
    {
        public GUIContent(string text)
        {
        }
    }

    public sealed class GUIStyle
    {
    }

    public class GUI
    {
        public static void DrawTextureWithTexCoords(Rect position, Texture image, Rect texCoords, bool alphaBlend)
        {
        }
    }

    public sealed class GUILayoutOption
    {
    }

    public class GUILayout
    {
        public static bool Button(string text, params GUILayoutOption[] options)
        {
            return false;
        }
    }

    public static class Input
    {
        public static Vector2 mouseScrollDelta
        {
            get { return new Vector2(0, EngineDouble.Wheel); }
        }

        public static bool GetKey(KeyCode key)
        {
            return EngineDouble.Held.Contains(key.ToString());
        }

        public static bool GetKeyDown(KeyCode key)
        {
            return EngineDouble.Tapped.Contains(key.ToString());
        }

        public static float GetAxisRaw(string axisName)
        {
            // One unit is 20 pixels.
            return (axisName == "Mouse X" ? EngineDouble.Mouse.x : EngineDouble.Mouse.y) / 20;
        }
    }

    public enum KeyCode
    {
        A, B, C, D, E, F, G, H, I, J, K, L, M, N, O, P, Q, R, S, T, U, V, W, X, Y, Z, Alpha0, Alpha1, Alpha2, Alpha3, Alpha4,
        Alpha5, Alpha6, Alpha7, Alpha8, Alpha9, Keypad0, Keypad1, Keypad2, Keypad3, Keypad4, Keypad5, Keypad6, Keypad7, Keypad8,
        Keypad9, F1, F2, F3, F4, F5, F6, F7, F8, F9, F10, F11, F12, Space, Return, Tab, Backspace, Escape, LeftArrow, RightArrow,
        UpArrow, DownArrow, LeftShift, RightShift, LeftControl, RightControl, LeftAlt, RightAlt, Insert, Delete, Home, End, PageUp,
        PageDown, Semicolon, Equals, Comma, Minus, Period, Slash, BackQuote, LeftBracket, Backslash, RightBracket, Quote, CapsLock,
        Pause, Mouse0, Mouse1, Mouse2,
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class SerializeField : Attribute
    {
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class TooltipAttribute : Attribute
    {
        public TooltipAttribute(string tooltip)
        {
        }
    }

    public sealed class MinAttribute : Attribute
    {
        public MinAttribute(float min)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class AddComponentMenu : Attribute
    {
        public AddComponentMenu(string menuName)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class DisallowMultipleComponent : Attribute
    {
    }
}

namespace UnityEngine.Rendering
{
    public class CommandBuffer
    {
        public string name { get; set; }

        public void IssuePluginEventAndData(IntPtr callback, int eventID, IntPtr data)
        {
        }

        public void Clear()
        {
        }

        public void Release()
        {
        }
    }
}

namespace UnityEngine.InputSystem
{
    public enum Key
    {
        A, B, C, D, E, F, G, H, I, J, K, L, M, N, O, P, Q, R, S, T, U, V, W, X, Y, Z, Digit0, Digit1, Digit2, Digit3, Digit4,
        Digit5, Digit6, Digit7, Digit8, Digit9, Numpad0, Numpad1, Numpad2, Numpad3, Numpad4, Numpad5, Numpad6, Numpad7, Numpad8,
        Numpad9, F1, F2, F3, F4, F5, F6, F7, F8, F9, F10, F11, F12, Space, Enter, Tab, Backspace, Escape, LeftArrow, RightArrow,
        UpArrow, DownArrow, LeftShift, RightShift, LeftCtrl, RightCtrl, LeftAlt, RightAlt, Insert, Delete, Home, End, PageUp,
        PageDown, Semicolon, Equals, Comma, Minus, Period, Slash, Backquote, LeftBracket, Backslash, RightBracket, Quote, CapsLock,
        Pause,
    }

    public static class InputSystem
    {
        public static InputSettings settings { get; } = new InputSettings();
    }

    public class InputSettings
    {
        public enum ScrollDeltaBehavior
        {
            UniformAcrossAllPlatforms, KeepPlatformSpecificInputRange,
        }

        public ScrollDeltaBehavior scrollDeltaBehavior { get; set; }
    }

    public class Keyboard
    {
        public static Keyboard current { get; } = new Keyboard();

        public Controls.KeyControl this[Key key]
        {
            get
            {
                string name = key.ToString();
                return new Controls.KeyControl
                {
                    isPressed = EngineDouble.Held.Contains(name),
                    wasPressedThisFrame = EngineDouble.WasPressed(name),
                };
            }
        }
    }

    public class Mouse
    {
        public static Mouse current { get; } = new Mouse();

        public Controls.ButtonControl leftButton
        {
            get { return Button("Mouse0"); }
        }

        public Controls.ButtonControl rightButton
        {
            get { return Button("Mouse1"); }
        }

        public Controls.ButtonControl middleButton
        {
            get { return Button("Mouse2"); }
        }

        public Controls.Vector2Control delta
        {
            get { return new Controls.Vector2Control(EngineDouble.Mouse); }
        }

        public Controls.Vector2Control scroll
        {
            get { return new Controls.Vector2Control(new Vector2(0, EngineDouble.Wheel)); }
        }

        private static Controls.ButtonControl Button(string name)
        {
            return new Controls.ButtonControl
            {
                isPressed = EngineDouble.Held.Contains(name),
                wasPressedThisFrame = EngineDouble.WasPressed(name),
            };
        }
    }
}

namespace UnityEngine.InputSystem.Controls
{
    public class ButtonControl
    {
        public bool isPressed { get; internal set; }
        public bool wasPressedThisFrame { get; internal set; }
    }

    public class KeyControl : ButtonControl
    {
    }

    public class Vector2Control
    {
        private readonly Vector2 value;

        internal Vector2Control(Vector2 value)
        {
            this.value = value;
        }

        public Vector2 ReadValue()
        {
            return value;
        }
    }
}
