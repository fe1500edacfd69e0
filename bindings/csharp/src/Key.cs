namespace Cairn
{
    /// <summary>
    /// Keys and mouse buttons by their Windows virtual-key codes, on every system. Any code from 0 to 255 is a key, also one without a
    /// name here.
    /// </summary>
    public enum Key : byte
    {
        /// <summary>The left mouse button.</summary>
        MouseLeft = 0x01,
        /// <summary>The right mouse button.</summary>
        MouseRight = 0x02,
        /// <summary>The middle mouse button.</summary>
        MouseMiddle = 0x04,
        /// <summary>The first mouse button at the side.</summary>
        MouseX1 = 0x05,
        /// <summary>The second mouse button at the side.</summary>
        MouseX2 = 0x06,
        /// <summary>Backspace.</summary>
        Backspace = 0x08,
        /// <summary>Tab.</summary>
        Tab = 0x09,
        /// <summary>Enter.</summary>
        Enter = 0x0d,
        /// <summary>Shift, either one.</summary>
        Shift = 0x10,
        /// <summary>Control, either one.</summary>
        Ctrl = 0x11,
        /// <summary>Alt, either one.</summary>
        Alt = 0x12,
        /// <summary>Pause.</summary>
        Pause = 0x13,
        /// <summary>Caps lock.</summary>
        CapsLock = 0x14,
        /// <summary>Escape.</summary>
        Escape = 0x1b,
        /// <summary>The space bar.</summary>
        Space = 0x20,
        /// <summary>Page up.</summary>
        PageUp = 0x21,
        /// <summary>Page down.</summary>
        PageDown = 0x22,
        /// <summary>End.</summary>
        End = 0x23,
        /// <summary>Home.</summary>
        Home = 0x24,
        /// <summary>The arrow to the left.</summary>
        Left = 0x25,
        /// <summary>The arrow up.</summary>
        Up = 0x26,
        /// <summary>The arrow to the right.</summary>
        Right = 0x27,
        /// <summary>The arrow down.</summary>
        Down = 0x28,
        /// <summary>Insert.</summary>
        Insert = 0x2d,
        /// <summary>Delete.</summary>
        Delete = 0x2e,
        /// <summary>0 in the row of digits.</summary>
        Digit0 = 0x30,
        /// <summary>1 in the row of digits.</summary>
        Digit1 = 0x31,
        /// <summary>2 in the row of digits.</summary>
        Digit2 = 0x32,
        /// <summary>3 in the row of digits.</summary>
        Digit3 = 0x33,
        /// <summary>4 in the row of digits.</summary>
        Digit4 = 0x34,
        /// <summary>5 in the row of digits.</summary>
        Digit5 = 0x35,
        /// <summary>6 in the row of digits.</summary>
        Digit6 = 0x36,
        /// <summary>7 in the row of digits.</summary>
        Digit7 = 0x37,
        /// <summary>8 in the row of digits.</summary>
        Digit8 = 0x38,
        /// <summary>9 in the row of digits.</summary>
        Digit9 = 0x39,
        /// <summary>The letter A.</summary>
        A = 0x41,
        /// <summary>The letter B.</summary>
        B = 0x42,
        /// <summary>The letter C.</summary>
        C = 0x43,
        /// <summary>The letter D.</summary>
        D = 0x44,
        /// <summary>The letter E.</summary>
        E = 0x45,
        /// <summary>The letter F.</summary>
        F = 0x46,
        /// <summary>The letter G.</summary>
        G = 0x47,
        /// <summary>The letter H.</summary>
        H = 0x48,
        /// <summary>The letter I.</summary>
        I = 0x49,
        /// <summary>The letter J.</summary>
        J = 0x4a,
        /// <summary>The letter K.</summary>
        K = 0x4b,
        /// <summary>The letter L.</summary>
        L = 0x4c,
        /// <summary>The letter M.</summary>
        M = 0x4d,
        /// <summary>The letter N.</summary>
        N = 0x4e,
        /// <summary>The letter O.</summary>
        O = 0x4f,
        /// <summary>The letter P.</summary>
        P = 0x50,
        /// <summary>The letter Q.</summary>
        Q = 0x51,
        /// <summary>The letter R.</summary>
        R = 0x52,
        /// <summary>The letter S.</summary>
        S = 0x53,
        /// <summary>The letter T.</summary>
        T = 0x54,
        /// <summary>The letter U.</summary>
        U = 0x55,
        /// <summary>The letter V.</summary>
        V = 0x56,
        /// <summary>The letter W.</summary>
        W = 0x57,
        /// <summary>The letter X.</summary>
        X = 0x58,
        /// <summary>The letter Y.</summary>
        Y = 0x59,
        /// <summary>The letter Z.</summary>
        Z = 0x5a,
        /// <summary>0 on the number pad.</summary>
        Num0 = 0x60,
        /// <summary>1 on the number pad.</summary>
        Num1 = 0x61,
        /// <summary>2 on the number pad.</summary>
        Num2 = 0x62,
        /// <summary>3 on the number pad.</summary>
        Num3 = 0x63,
        /// <summary>4 on the number pad.</summary>
        Num4 = 0x64,
        /// <summary>5 on the number pad.</summary>
        Num5 = 0x65,
        /// <summary>6 on the number pad.</summary>
        Num6 = 0x66,
        /// <summary>7 on the number pad.</summary>
        Num7 = 0x67,
        /// <summary>8 on the number pad.</summary>
        Num8 = 0x68,
        /// <summary>9 on the number pad.</summary>
        Num9 = 0x69,
        /// <summary>F1.</summary>
        F1 = 0x70,
        /// <summary>F2.</summary>
        F2 = 0x71,
        /// <summary>F3.</summary>
        F3 = 0x72,
        /// <summary>F4.</summary>
        F4 = 0x73,
        /// <summary>F5.</summary>
        F5 = 0x74,
        /// <summary>F6.</summary>
        F6 = 0x75,
        /// <summary>F7.</summary>
        F7 = 0x76,
        /// <summary>F8.</summary>
        F8 = 0x77,
        /// <summary>F9.</summary>
        F9 = 0x78,
        /// <summary>F10.</summary>
        F10 = 0x79,
        /// <summary>F11.</summary>
        F11 = 0x7a,
        /// <summary>F12.</summary>
        F12 = 0x7b,
        /// <summary>F13.</summary>
        F13 = 0x7c,
        /// <summary>F14.</summary>
        F14 = 0x7d,
        /// <summary>F15.</summary>
        F15 = 0x7e,
        /// <summary>F16.</summary>
        F16 = 0x7f,
        /// <summary>F17.</summary>
        F17 = 0x80,
        /// <summary>F18.</summary>
        F18 = 0x81,
        /// <summary>F19.</summary>
        F19 = 0x82,
        /// <summary>F20.</summary>
        F20 = 0x83,
        /// <summary>F21.</summary>
        F21 = 0x84,
        /// <summary>F22.</summary>
        F22 = 0x85,
        /// <summary>F23.</summary>
        F23 = 0x86,
        /// <summary>F24.</summary>
        F24 = 0x87,
        /// <summary>The left shift key.</summary>
        LeftShift = 0xa0,
        /// <summary>The right shift key.</summary>
        RightShift = 0xa1,
        /// <summary>The left control key.</summary>
        LeftCtrl = 0xa2,
        /// <summary>The right control key.</summary>
        RightCtrl = 0xa3,
        /// <summary>The left alt key.</summary>
        LeftAlt = 0xa4,
        /// <summary>The right alt key.</summary>
        RightAlt = 0xa5,
        /// <summary>The semicolon key of a US keyboard; the names below follow the same layout.</summary>
        Semicolon = 0xba,
        /// <summary>The equals sign.</summary>
        EqualsSign = 0xbb,
        /// <summary>The comma.</summary>
        Comma = 0xbc,
        /// <summary>The minus.</summary>
        Minus = 0xbd,
        /// <summary>The period.</summary>
        Period = 0xbe,
        /// <summary>The slash.</summary>
        Slash = 0xbf,
        /// <summary>The backquote.</summary>
        Backquote = 0xc0,
        /// <summary>The left bracket.</summary>
        LeftBracket = 0xdb,
        /// <summary>The backslash.</summary>
        Backslash = 0xdc,
        /// <summary>The right bracket.</summary>
        RightBracket = 0xdd,
        /// <summary>The quote.</summary>
        Quote = 0xde,
    }
}
