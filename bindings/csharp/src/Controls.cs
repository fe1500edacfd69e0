using System;
using System.Collections.Generic;

namespace Cairn
{
    /// <summary>Controls of one latent step. By default nothing moves and no key is held.</summary>
    public struct Controls : IEquatable<Controls>
    {
        // Bit key % 64 of word key / 64.
        private ulong first;
        private ulong second;
        private ulong third;
        private ulong fourth;

        /// <summary>Keys held at any time during the step.</summary>
        /// <param name="keys">In any order.</param>
        public Controls(params Key[] keys) : this()
        {
            if (keys == null) throw new ArgumentNullException(nameof(keys));
            foreach (Key key in keys) Hold(key);
        }

        internal unsafe Controls(Native.controls from) : this()
        {
            MouseX = from.mouse_dx;
            MouseY = from.mouse_dy;
            Scroll = from.scroll;
            first = from.keys[0];
            second = from.keys[1];
            third = from.keys[2];
            fourth = from.keys[3];
        }

        /// <summary>Horizontal mouse motion in raw counts, summed over the step, right positive; -32768 to 32768.</summary>
        public float MouseX { get; set; }

        /// <summary>Vertical mouse motion, down positive; otherwise as <see cref="MouseX"/>.</summary>
        public float MouseY { get; set; }

        /// <summary>Wheel movement, up positive; only its sign matters.</summary>
        public float Scroll { get; set; }

        /// <summary>Codes of all keys that are held.</summary>
        public IEnumerable<Key> Keys
        {
            get
            {
                for (int code = 0; code < 256; code++)
                {
                    if (IsHeld((Key)code)) yield return (Key)code;
                }
            }
        }

        /// <summary>Whether a key is held.</summary>
        /// <param name="key">The key.</param>
        public bool IsHeld(Key key)
        {
            return (Word((int)key / 64) & Bit(key)) != 0;
        }

        /// <summary>Adds a key to those that are held.</summary>
        /// <param name="key">The key.</param>
        public void Hold(Key key)
        {
            Set((int)key / 64, Word((int)key / 64) | Bit(key));
        }

        /// <summary>Releases a key.</summary>
        /// <param name="key">The key.</param>
        public void Release(Key key)
        {
            Set((int)key / 64, Word((int)key / 64) & ~Bit(key));
        }

        /// <summary>Whether both are equal.</summary>
        /// <param name="other">The value to compare with.</param>
        public bool Equals(Controls other)
        {
            return first == other.first && second == other.second && third == other.third && fourth == other.fourth
                && MouseX.Equals(other.MouseX) && MouseY.Equals(other.MouseY) && Scroll.Equals(other.Scroll);
        }

        /// <summary>Whether the other object is an equal value of this type.</summary>
        /// <param name="other">The value to compare with.</param>
        public override bool Equals(object other)
        {
            return other is Controls && Equals((Controls)other);
        }

        /// <summary>Hash code; equal for equal controls.</summary>
        public override int GetHashCode()
        {
            ulong keys = first ^ second * 31 ^ third * 37 ^ fourth * 41;
            return keys.GetHashCode() ^ MouseX.GetHashCode() ^ MouseY.GetHashCode() * 31 ^ Scroll.GetHashCode() * 37;
        }

        internal unsafe Native.controls Struct()
        {
            var native = new Native.controls
            {
                struct_size = (uint)sizeof(Native.controls),
                mouse_dx = MouseX,
                mouse_dy = MouseY,
                scroll = Scroll,
            };
            native.keys[0] = first;
            native.keys[1] = second;
            native.keys[2] = third;
            native.keys[3] = fourth;
            return native;
        }

        private static ulong Bit(Key key)
        {
            return 1ul << (int)key % 64;
        }

        private ulong Word(int which)
        {
            return which == 0 ? first : which == 1 ? second : which == 2 ? third : fourth;
        }

        private void Set(int which, ulong word)
        {
            if (which == 0) first = word;
            else if (which == 1) second = word;
            else if (which == 2) third = word;
            else fourth = word;
        }
    }
}
