using System;
using System.Collections.Generic;

namespace Cairn
{
    /// <summary>Controls of one latent step. As it is made: nothing moves, no key is held.</summary>
    public struct Controls : IEquatable<Controls>
    {
        // Bit key % 64 of word key / 64.
        private ulong first;
        private ulong second;
        private ulong third;
        private ulong fourth;

        /// <summary>Keys that are held at any moment of the step.</summary>
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

        /// <summary>Mouse motion in raw counts, summed over the step, right positive; -32768 to 32768.</summary>
        public float MouseX { get; set; }

        /// <summary>The same, down positive.</summary>
        public float MouseY { get; set; }

        /// <summary>The wheel, up positive; its sign counts.</summary>
        public float Scroll { get; set; }

        /// <summary>All keys that are held, by their codes.</summary>
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
        /// <param name="key">Which one.</param>
        public bool IsHeld(Key key)
        {
            return (Word((int)key / 64) & Bit(key)) != 0;
        }

        /// <summary>Holds a key, too.</summary>
        /// <param name="key">Which one.</param>
        public void Hold(Key key)
        {
            Set((int)key / 64, Word((int)key / 64) | Bit(key));
        }

        /// <summary>Lets go of a key.</summary>
        /// <param name="key">Which one.</param>
        public void Release(Key key)
        {
            Set((int)key / 64, Word((int)key / 64) & ~Bit(key));
        }

        /// <summary>Whether all of both is the same.</summary>
        /// <param name="other">What to compare it with.</param>
        public bool Equals(Controls other)
        {
            return first == other.first && second == other.second && third == other.third && fourth == other.fourth
                && MouseX.Equals(other.MouseX) && MouseY.Equals(other.MouseY) && Scroll.Equals(other.Scroll);
        }

        /// <summary>Whether it is the same controls.</summary>
        /// <param name="other">What to compare it with.</param>
        public override bool Equals(object other)
        {
            return other is Controls && Equals((Controls)other);
        }

        /// <summary>The same for equal controls.</summary>
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
