using System.Collections.Generic;
using UnityEngine;
#if CAIRN_INPUT_SYSTEM && ENABLE_INPUT_SYSTEM
using UnityEngine.InputSystem;
using Pressed = UnityEngine.InputSystem.Key;
using Key = Cairn.Key;
#endif

namespace Cairn.Unity
{
    /// <summary>Keyboard and mouse, by whichever of Unity's two ways the project has.</summary>
    internal static class Devices
    {
#if CAIRN_INPUT_SYSTEM && ENABLE_INPUT_SYSTEM
        /// <summary>Places on the keyboard; a world's keys are named by what stands there on an American one.</summary>
        private static readonly Dictionary<Pressed, Key> Known = new Dictionary<Pressed, Key>
        {
            { Pressed.A, Key.A }, { Pressed.B, Key.B }, { Pressed.C, Key.C }, { Pressed.D, Key.D }, { Pressed.E, Key.E },
            { Pressed.F, Key.F }, { Pressed.G, Key.G }, { Pressed.H, Key.H }, { Pressed.I, Key.I }, { Pressed.J, Key.J },
            { Pressed.K, Key.K }, { Pressed.L, Key.L }, { Pressed.M, Key.M }, { Pressed.N, Key.N }, { Pressed.O, Key.O },
            { Pressed.P, Key.P }, { Pressed.Q, Key.Q }, { Pressed.R, Key.R }, { Pressed.S, Key.S }, { Pressed.T, Key.T },
            { Pressed.U, Key.U }, { Pressed.V, Key.V }, { Pressed.W, Key.W }, { Pressed.X, Key.X }, { Pressed.Y, Key.Y },
            { Pressed.Z, Key.Z }, { Pressed.Digit0, Key.Digit0 }, { Pressed.Digit1, Key.Digit1 }, { Pressed.Digit2, Key.Digit2 },
            { Pressed.Digit3, Key.Digit3 }, { Pressed.Digit4, Key.Digit4 }, { Pressed.Digit5, Key.Digit5 }, { Pressed.Digit6, Key.Digit6 },
            { Pressed.Digit7, Key.Digit7 }, { Pressed.Digit8, Key.Digit8 }, { Pressed.Digit9, Key.Digit9 }, { Pressed.Numpad0, Key.Num0 },
            { Pressed.Numpad1, Key.Num1 }, { Pressed.Numpad2, Key.Num2 }, { Pressed.Numpad3, Key.Num3 }, { Pressed.Numpad4, Key.Num4 },
            { Pressed.Numpad5, Key.Num5 }, { Pressed.Numpad6, Key.Num6 }, { Pressed.Numpad7, Key.Num7 }, { Pressed.Numpad8, Key.Num8 },
            { Pressed.Numpad9, Key.Num9 }, { Pressed.F1, Key.F1 }, { Pressed.F2, Key.F2 }, { Pressed.F3, Key.F3 }, { Pressed.F4, Key.F4 },
            { Pressed.F5, Key.F5 }, { Pressed.F6, Key.F6 }, { Pressed.F7, Key.F7 }, { Pressed.F8, Key.F8 }, { Pressed.F9, Key.F9 },
            { Pressed.F10, Key.F10 }, { Pressed.F11, Key.F11 }, { Pressed.F12, Key.F12 }, { Pressed.Space, Key.Space },
            { Pressed.Enter, Key.Enter }, { Pressed.Tab, Key.Tab }, { Pressed.Backspace, Key.Backspace }, { Pressed.Escape, Key.Escape },
            { Pressed.LeftArrow, Key.Left }, { Pressed.RightArrow, Key.Right }, { Pressed.UpArrow, Key.Up },
            { Pressed.DownArrow, Key.Down }, { Pressed.LeftShift, Key.LeftShift }, { Pressed.RightShift, Key.RightShift },
            { Pressed.LeftCtrl, Key.LeftCtrl }, { Pressed.RightCtrl, Key.RightCtrl }, { Pressed.LeftAlt, Key.LeftAlt },
            { Pressed.RightAlt, Key.RightAlt }, { Pressed.Insert, Key.Insert }, { Pressed.Delete, Key.Delete }, { Pressed.Home, Key.Home },
            { Pressed.End, Key.End }, { Pressed.PageUp, Key.PageUp }, { Pressed.PageDown, Key.PageDown },
            { Pressed.Semicolon, Key.Semicolon }, { Pressed.Equals, Key.EqualsSign }, { Pressed.Comma, Key.Comma },
            { Pressed.Minus, Key.Minus }, { Pressed.Period, Key.Period }, { Pressed.Slash, Key.Slash },
            { Pressed.Backquote, Key.Backquote }, { Pressed.LeftBracket, Key.LeftBracket }, { Pressed.Backslash, Key.Backslash },
            { Pressed.RightBracket, Key.RightBracket }, { Pressed.Quote, Key.Quote }, { Pressed.CapsLock, Key.CapsLock },
            { Pressed.Pause, Key.Pause },
        };

        /// <summary>What is held, how far the mouse went in pixels, and the wheel in notches.</summary>
        internal static void Read(List<Key> held, out Vector2 mouse, out float wheel)
        {
            mouse = Vector2.zero;
            wheel = 0;
            Keyboard keyboard = Keyboard.current;
            if (keyboard != null)
            {
                foreach (KeyValuePair<Pressed, Key> pair in Known)
                {
                    if (keyboard[pair.Key].isPressed) held.Add(pair.Value);
                }
            }
            Mouse moved = Mouse.current;
            if (moved == null) return;
            if (moved.leftButton.isPressed) held.Add(Key.MouseLeft);
            if (moved.rightButton.isPressed) held.Add(Key.MouseRight);
            if (moved.middleButton.isPressed) held.Add(Key.MouseMiddle);
            mouse = moved.delta.ReadValue();
            // Windows counts 120 to a notch.
            wheel = moved.scroll.ReadValue().y / 120;
        }
#elif ENABLE_LEGACY_INPUT_MANAGER
        /// <summary>The Input Manager's unit of the mouse's axes in pixels, at the sensitivity of 0.1 that new projects have.</summary>
        private const float PixelsPerUnit = 20;

        private static readonly Dictionary<KeyCode, Key> Known = new Dictionary<KeyCode, Key>
        {
            { KeyCode.A, Key.A }, { KeyCode.B, Key.B }, { KeyCode.C, Key.C }, { KeyCode.D, Key.D }, { KeyCode.E, Key.E },
            { KeyCode.F, Key.F }, { KeyCode.G, Key.G }, { KeyCode.H, Key.H }, { KeyCode.I, Key.I }, { KeyCode.J, Key.J },
            { KeyCode.K, Key.K }, { KeyCode.L, Key.L }, { KeyCode.M, Key.M }, { KeyCode.N, Key.N }, { KeyCode.O, Key.O },
            { KeyCode.P, Key.P }, { KeyCode.Q, Key.Q }, { KeyCode.R, Key.R }, { KeyCode.S, Key.S }, { KeyCode.T, Key.T },
            { KeyCode.U, Key.U }, { KeyCode.V, Key.V }, { KeyCode.W, Key.W }, { KeyCode.X, Key.X }, { KeyCode.Y, Key.Y },
            { KeyCode.Z, Key.Z }, { KeyCode.Alpha0, Key.Digit0 }, { KeyCode.Alpha1, Key.Digit1 }, { KeyCode.Alpha2, Key.Digit2 },
            { KeyCode.Alpha3, Key.Digit3 }, { KeyCode.Alpha4, Key.Digit4 }, { KeyCode.Alpha5, Key.Digit5 }, { KeyCode.Alpha6, Key.Digit6 },
            { KeyCode.Alpha7, Key.Digit7 }, { KeyCode.Alpha8, Key.Digit8 }, { KeyCode.Alpha9, Key.Digit9 }, { KeyCode.Keypad0, Key.Num0 },
            { KeyCode.Keypad1, Key.Num1 }, { KeyCode.Keypad2, Key.Num2 }, { KeyCode.Keypad3, Key.Num3 }, { KeyCode.Keypad4, Key.Num4 },
            { KeyCode.Keypad5, Key.Num5 }, { KeyCode.Keypad6, Key.Num6 }, { KeyCode.Keypad7, Key.Num7 }, { KeyCode.Keypad8, Key.Num8 },
            { KeyCode.Keypad9, Key.Num9 }, { KeyCode.F1, Key.F1 }, { KeyCode.F2, Key.F2 }, { KeyCode.F3, Key.F3 }, { KeyCode.F4, Key.F4 },
            { KeyCode.F5, Key.F5 }, { KeyCode.F6, Key.F6 }, { KeyCode.F7, Key.F7 }, { KeyCode.F8, Key.F8 }, { KeyCode.F9, Key.F9 },
            { KeyCode.F10, Key.F10 }, { KeyCode.F11, Key.F11 }, { KeyCode.F12, Key.F12 }, { KeyCode.Space, Key.Space },
            { KeyCode.Return, Key.Enter }, { KeyCode.Tab, Key.Tab }, { KeyCode.Backspace, Key.Backspace }, { KeyCode.Escape, Key.Escape },
            { KeyCode.LeftArrow, Key.Left }, { KeyCode.RightArrow, Key.Right }, { KeyCode.UpArrow, Key.Up },
            { KeyCode.DownArrow, Key.Down }, { KeyCode.LeftShift, Key.LeftShift }, { KeyCode.RightShift, Key.RightShift },
            { KeyCode.LeftControl, Key.LeftCtrl }, { KeyCode.RightControl, Key.RightCtrl }, { KeyCode.LeftAlt, Key.LeftAlt },
            { KeyCode.RightAlt, Key.RightAlt }, { KeyCode.Insert, Key.Insert }, { KeyCode.Delete, Key.Delete }, { KeyCode.Home, Key.Home },
            { KeyCode.End, Key.End }, { KeyCode.PageUp, Key.PageUp }, { KeyCode.PageDown, Key.PageDown },
            { KeyCode.Semicolon, Key.Semicolon }, { KeyCode.Equals, Key.EqualsSign }, { KeyCode.Comma, Key.Comma },
            { KeyCode.Minus, Key.Minus }, { KeyCode.Period, Key.Period }, { KeyCode.Slash, Key.Slash },
            { KeyCode.BackQuote, Key.Backquote }, { KeyCode.LeftBracket, Key.LeftBracket }, { KeyCode.Backslash, Key.Backslash },
            { KeyCode.RightBracket, Key.RightBracket }, { KeyCode.Quote, Key.Quote }, { KeyCode.CapsLock, Key.CapsLock },
            { KeyCode.Pause, Key.Pause },
            { KeyCode.Mouse0, Key.MouseLeft }, { KeyCode.Mouse1, Key.MouseRight }, { KeyCode.Mouse2, Key.MouseMiddle },
        };

        /// <summary>What is held, how far the mouse went in pixels, and the wheel in notches.</summary>
        internal static void Read(List<Key> held, out Vector2 mouse, out float wheel)
        {
            foreach (KeyValuePair<KeyCode, Key> pair in Known)
            {
                if (Input.GetKey(pair.Key)) held.Add(pair.Value);
            }
            mouse = new Vector2(Input.GetAxisRaw("Mouse X"), Input.GetAxisRaw("Mouse Y")) * PixelsPerUnit;
            wheel = Input.mouseScrollDelta.y;
        }
#else
        /// <summary>Nothing: the project has neither.</summary>
        internal static void Read(List<Key> held, out Vector2 mouse, out float wheel)
        {
            mouse = Vector2.zero;
            wheel = 0;
        }
#endif
    }
}
