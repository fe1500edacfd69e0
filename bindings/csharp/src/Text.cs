using System;
using System.Runtime.InteropServices;
using System.Text;

namespace Cairn
{
    /// <summary>Converts texts to and from the library's form.</summary>
    internal static unsafe class Text
    {
        private static readonly UTF8Encoding Strict = new UTF8Encoding(false, true);
        private static readonly UTF8Encoding Lenient = new UTF8Encoding(false, false);

        /// <summary>A function of the library that copies a text into a buffer.</summary>
        internal delegate int Reader(byte* text, UIntPtr capacity, UIntPtr* length);

        /// <summary>UTF-8 with a terminating NUL; null for null.</summary>
        internal static byte[] Encode(string text, string parameter)
        {
            if (text == null) return null;
            if (text.IndexOf('\0') >= 0) throw new ArgumentException("It holds a NUL character, at which the library would cut it. Take it out", parameter);
            try
            {
                var bytes = new byte[Strict.GetByteCount(text) + 1];
                Strict.GetBytes(text, 0, text.Length, bytes, 0);
                return bytes;
            }
            catch (EncoderFallbackException)
            {
                throw new ArgumentException("It is not valid Unicode: half of a pair stands alone. Use a text of valid Unicode", parameter);
            }
        }

        /// <summary>The text that a function copies, of any length.</summary>
        internal static string Read(Reader read)
        {
            var capacity = 1024;
            while (true)
            {
                var bytes = new byte[capacity];
                UIntPtr length;
                int result;
                fixed (byte* at = bytes)
                {
                    result = read(at, (UIntPtr)capacity, &length);
                }
                if (result != Native.TRUNCATED)
                {
                    CairnException.ThrowIfFailed(result);
                    return Lenient.GetString(bytes, 0, (int)length);
                }
                capacity = (int)length + 1;
            }
        }

        /// <summary>A text that ends with a NUL or with its buffer.</summary>
        internal static string Decode(byte* text, int room)
        {
            var length = 0;
            while (length < room && text[length] != 0) length++;
            return Lenient.GetString(text, length);
        }

        /// <summary>A text with a terminating NUL; empty for a null pointer.</summary>
        internal static string Decode(IntPtr text)
        {
            return text == IntPtr.Zero ? "" : Decode((byte*)text, int.MaxValue);
        }
    }
}
