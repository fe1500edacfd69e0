using System.Collections.Generic;
using UnityEngine;

namespace Cairn.Unity
{
    /// <summary>
    /// The player's input for a world: keys that are held, and movement of mouse and wheel since the world's last step.
    /// Reads the Input System if the project has it, otherwise the Input Manager.
    /// </summary>
    [AddComponentMenu("Cairn/Cairn Input")]
    [DisallowMultipleComponent]
    public sealed class CairnInput : MonoBehaviour
    {
        [SerializeField, Tooltip("Factor on movements of the mouse.")]
        private float mouseSpeed = 1;

        [SerializeField, Tooltip("Keeps the cursor in the middle while the component is on.")]
        private bool lockCursor = true;

        /// <summary>Largest mouse motion of a step in either direction; a world rejects controls beyond it.</summary>
        private const float MaxMotion = 32768;

        private readonly object sampling = new object();
        private Vector2 moved;
        private float scrolled;
        private Key[] held = new Key[0];
        /// <summary>Keys held in any frame since the last step, so that a key tapped between two steps counts.</summary>
        private readonly HashSet<Key> touched = new HashSet<Key>();

        /// <summary>Factor on mouse movement.</summary>
        public float MouseSpeed
        {
            get { return mouseSpeed; }
            set { mouseSpeed = value; }
        }

        /// <summary>Whether the cursor is locked to the centre.</summary>
        public bool LockCursor
        {
            get { return lockCursor; }
            set { lockCursor = value; }
        }

        /// <summary>
        /// Takes the controls of a world's next step: each movement counts once, and a key counts if it was held at any time since the last call.
        /// From any thread.
        /// </summary>
        public Controls Take()
        {
            lock (sampling)
            {
                var controls = new Controls(held) { MouseX = moved.x, MouseY = moved.y, Scroll = scrolled };
                foreach (Key key in touched) controls.Hold(key);
                touched.Clear();
                moved = Vector2.zero;
                scrolled = 0;
                return controls;
            }
        }

        private void OnEnable()
        {
            if (lockCursor) Cursor.lockState = CursorLockMode.Locked;
        }

        private void OnDisable()
        {
            if (lockCursor) Cursor.lockState = CursorLockMode.None;
            lock (sampling)
            {
                held = new Key[0];
                touched.Clear();
                moved = Vector2.zero;
                scrolled = 0;
            }
        }

        private void Update()
        {
            var keys = new List<Key>();
            Vector2 mouse;
            float wheel;
            Devices.Read(keys, out mouse, out wheel);
            lock (sampling)
            {
                held = keys.ToArray();
                touched.UnionWith(held);
                // Unity's y points up, a world's down.
                moved = new Vector2(Add(moved.x, mouse.x * mouseSpeed), Add(moved.y, -mouse.y * mouseSpeed));
                scrolled = Add(scrolled, wheel);
            }
        }

        /// <summary>The sum, clamped to the range of controls; an increment that is not finite counts as 0.</summary>
        private static float Add(float sum, float increment)
        {
            if (float.IsNaN(increment) || float.IsInfinity(increment)) return sum;
            return Mathf.Clamp(sum + increment, -MaxMotion, MaxMotion);
        }
    }
}
