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

        private readonly object sampling = new object();
        private Vector2 moved;
        private float scrolled;
        private Key[] held = new Key[0];

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

        /// <summary>Takes the controls of a world's next step; each movement counts once. From any thread.</summary>
        public Controls Take()
        {
            lock (sampling)
            {
                var controls = new Controls(held) { MouseX = moved.x, MouseY = moved.y, Scroll = scrolled };
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
            lock (sampling) held = new Key[0];
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
                // Unity's y points up, a world's down.
                moved += new Vector2(mouse.x, -mouse.y) * mouseSpeed;
                scrolled += wheel;
            }
        }
    }
}
