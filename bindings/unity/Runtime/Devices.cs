#if CAIRN_INPUT_SYSTEM && ENABLE_INPUT_SYSTEM
#define CAIRN_BY_INPUT_SYSTEM
#elif ENABLE_LEGACY_INPUT_MANAGER
#define CAIRN_BY_INPUT_MANAGER
#endif
using System.Collections.Generic;
using UnityEngine;
#if CAIRN_BY_INPUT_SYSTEM
using UnityEngine.InputSystem;
using UnityEngine.InputSystem.Controls;
using On = UnityEngine.InputSystem.Key;
using Key = Cairn.Key;
#elif CAIRN_BY_INPUT_MANAGER
using On = UnityEngine.KeyCode;
#endif

namespace Cairn.Unity
{
    /// <summary>Keyboard and mouse, through whichever of Unity's two input systems the project has.</summary>
    internal static class Devices
    {
#if CAIRN_BY_INPUT_SYSTEM || CAIRN_BY_INPUT_MANAGER
        /// <summary>
        /// Physical keys; a world's keys are named after the US layout. Both sides of Shift, Ctrl and Alt have the key's one code, with which
        /// worlds are trained.
        /// </summary>
        private static readonly Dictionary<On, Key> Known = new Dictionary<On, Key>
        {
            { On.A, Key.A }, { On.B, Key.B }, { On.C, Key.C }, { On.D, Key.D }, { On.E, Key.E }, { On.F, Key.F }, { On.G, Key.G },
            { On.H, Key.H }, { On.I, Key.I }, { On.J, Key.J }, { On.K, Key.K }, { On.L, Key.L }, { On.M, Key.M }, { On.N, Key.N },
            { On.O, Key.O }, { On.P, Key.P }, { On.Q, Key.Q }, { On.R, Key.R }, { On.S, Key.S }, { On.T, Key.T }, { On.U, Key.U },
            { On.V, Key.V }, { On.W, Key.W }, { On.X, Key.X }, { On.Y, Key.Y }, { On.Z, Key.Z }, { On.F1, Key.F1 },
            { On.F2, Key.F2 }, { On.F3, Key.F3 }, { On.F4, Key.F4 }, { On.F5, Key.F5 }, { On.F6, Key.F6 }, { On.F7, Key.F7 },
            { On.F8, Key.F8 }, { On.F9, Key.F9 }, { On.F10, Key.F10 }, { On.F11, Key.F11 }, { On.F12, Key.F12 },
            { On.Space, Key.Space }, { On.Tab, Key.Tab }, { On.Backspace, Key.Backspace }, { On.Escape, Key.Escape },
            { On.LeftArrow, Key.Left }, { On.RightArrow, Key.Right }, { On.UpArrow, Key.Up }, { On.DownArrow, Key.Down },
            { On.LeftShift, Key.Shift }, { On.RightShift, Key.Shift }, { On.LeftAlt, Key.Alt },
            { On.RightAlt, Key.Alt }, { On.Insert, Key.Insert }, { On.Delete, Key.Delete }, { On.Home, Key.Home },
            { On.End, Key.End }, { On.PageUp, Key.PageUp }, { On.PageDown, Key.PageDown }, { On.Semicolon, Key.Semicolon },
            { On.Equals, Key.EqualsSign }, { On.Comma, Key.Comma }, { On.Minus, Key.Minus }, { On.Period, Key.Period },
            { On.Slash, Key.Slash }, { On.LeftBracket, Key.LeftBracket }, { On.Backslash, Key.Backslash },
            { On.RightBracket, Key.RightBracket }, { On.Quote, Key.Quote }, { On.CapsLock, Key.CapsLock }, { On.Pause, Key.Pause },
#if CAIRN_BY_INPUT_SYSTEM
            { On.Digit0, Key.Digit0 }, { On.Digit1, Key.Digit1 }, { On.Digit2, Key.Digit2 }, { On.Digit3, Key.Digit3 },
            { On.Digit4, Key.Digit4 }, { On.Digit5, Key.Digit5 }, { On.Digit6, Key.Digit6 }, { On.Digit7, Key.Digit7 },
            { On.Digit8, Key.Digit8 }, { On.Digit9, Key.Digit9 }, { On.Numpad0, Key.Num0 }, { On.Numpad1, Key.Num1 },
            { On.Numpad2, Key.Num2 }, { On.Numpad3, Key.Num3 }, { On.Numpad4, Key.Num4 }, { On.Numpad5, Key.Num5 },
            { On.Numpad6, Key.Num6 }, { On.Numpad7, Key.Num7 }, { On.Numpad8, Key.Num8 }, { On.Numpad9, Key.Num9 },
            { On.Enter, Key.Enter }, { On.LeftCtrl, Key.Ctrl }, { On.RightCtrl, Key.Ctrl },
            { On.Backquote, Key.Backquote },
#else
            { On.Alpha0, Key.Digit0 }, { On.Alpha1, Key.Digit1 }, { On.Alpha2, Key.Digit2 }, { On.Alpha3, Key.Digit3 },
            { On.Alpha4, Key.Digit4 }, { On.Alpha5, Key.Digit5 }, { On.Alpha6, Key.Digit6 }, { On.Alpha7, Key.Digit7 },
            { On.Alpha8, Key.Digit8 }, { On.Alpha9, Key.Digit9 }, { On.Keypad0, Key.Num0 }, { On.Keypad1, Key.Num1 },
            { On.Keypad2, Key.Num2 }, { On.Keypad3, Key.Num3 }, { On.Keypad4, Key.Num4 }, { On.Keypad5, Key.Num5 },
            { On.Keypad6, Key.Num6 }, { On.Keypad7, Key.Num7 }, { On.Keypad8, Key.Num8 }, { On.Keypad9, Key.Num9 },
            { On.Return, Key.Enter }, { On.LeftControl, Key.Ctrl }, { On.RightControl, Key.Ctrl },
            { On.BackQuote, Key.Backquote }, { On.Mouse0, Key.MouseLeft }, { On.Mouse1, Key.MouseRight },
            { On.Mouse2, Key.MouseMiddle },
#endif
        };
#endif

#if CAIRN_BY_INPUT_SYSTEM
        /// <summary>
        /// Wheel units per notch: Windows' own 120, or 1. The Input System has a setting for it since version 1.9, which Unity heeds since
        /// 6000.0.9; before that Unity alone decides, for 1 since 2023.2.
        /// </summary>
        private static float PerNotch
        {
            get
            {
#if CAIRN_SCROLL_SETTING && CAIRN_INPUT_SYSTEM_1_9
                bool uniform = InputSystem.settings.scrollDeltaBehavior == InputSettings.ScrollDeltaBehavior.UniformAcrossAllPlatforms;
                return uniform ? 1 : 120;
#elif CAIRN_SCROLL_SETTING || UNITY_2023_2_OR_NEWER
                return 1;
#else
                return 120;
#endif
            }
        }

        /// <summary>Keys held, or pressed and released, since the last frame, mouse movement in pixels, and wheel movement in notches.</summary>
        internal static void Read(List<Key> held, out Vector2 mouse, out float wheel)
        {
            mouse = Vector2.zero;
            wheel = 0;
            Keyboard keyboard = Keyboard.current;
            if (keyboard != null)
            {
                foreach (KeyValuePair<On, Key> pair in Known)
                {
                    if (IsHeld(keyboard[pair.Key])) held.Add(pair.Value);
                }
            }
            Mouse moved = Mouse.current;
            if (moved == null) return;
            if (IsHeld(moved.leftButton)) held.Add(Key.MouseLeft);
            if (IsHeld(moved.rightButton)) held.Add(Key.MouseRight);
            if (IsHeld(moved.middleButton)) held.Add(Key.MouseMiddle);
            mouse = moved.delta.ReadValue();
            wheel = moved.scroll.ReadValue().y / PerNotch;
        }

        /// <summary>
        /// Whether a key is down, or was within this frame: pressed and released between two frames, it is up again by now. The Input System
        /// tells the second only since version 1.9.
        /// </summary>
        private static bool IsHeld(ButtonControl key)
        {
            return key.isPressed || key.wasPressedThisFrame;
        }
#elif CAIRN_BY_INPUT_MANAGER
        /// <summary>Pixels per unit of the Input Manager's mouse axes, at a new project's sensitivity of 0.1.</summary>
        private const float PixelsPerUnit = 20;

        /// <summary>Keys held, or pressed and released, since the last frame, mouse movement in pixels, and wheel movement in notches.</summary>
        internal static void Read(List<Key> held, out Vector2 mouse, out float wheel)
        {
            foreach (KeyValuePair<On, Key> pair in Known)
            {
                // A key pressed and released between two frames is up again by now.
                if (Input.GetKey(pair.Key) || Input.GetKeyDown(pair.Key)) held.Add(pair.Value);
            }
            mouse = new Vector2(Input.GetAxisRaw("Mouse X"), Input.GetAxisRaw("Mouse Y")) * PixelsPerUnit;
            wheel = Input.mouseScrollDelta.y;
        }
#else
        /// <summary>Nothing: the project has no input system.</summary>
        internal static void Read(List<Key> held, out Vector2 mouse, out float wheel)
        {
            mouse = Vector2.zero;
            wheel = 0;
        }
#endif
    }
}
