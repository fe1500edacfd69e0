using System;
using UnityEngine;

namespace Cairn.Unity.Samples
{
    /// <summary>
    /// A walk through the world inside the library: put it on an empty game object, drag Place into it, and press Play. W, A, S and D walk,
    /// the mouse looks around.
    /// </summary>
    [AddComponentMenu("Cairn/Samples/Walk")]
    public sealed class Walk : MonoBehaviour
    {
        [SerializeField, Tooltip("The picture to start from, as a PPM file whose name ends in .bytes.")]
        private TextAsset place = null;

        [SerializeField, Tooltip("Processor on which the world runs.")]
        private WorldProcessor processor = WorldProcessor.Graphics;

        private void Start()
        {
            if (place == null)
            {
                Debug.LogError("Walk: drag the file Place, which came with this sample, into the field Place.", this);
                return;
            }
            int width;
            int height;
            byte[] pixels = Read(place.bytes, out width, out height);
            // Components are enabled with their game object, so their properties are set before.
            var shown = new GameObject("Cairn");
            shown.SetActive(false);
            var input = shown.AddComponent<CairnInput>();
            var world = shown.AddComponent<CairnWorld>();
            world.SetSeed(pixels, width, height);
            world.Processor = processor;
            world.Input = input;
            var presenter = shown.AddComponent<CairnPresenter>();
            presenter.World = world;
            shown.SetActive(true);
        }

        /// <summary>The pixels of a binary PPM file, with an alpha of 255.</summary>
        private static byte[] Read(byte[] file, out int width, out int height)
        {
            int at = 0;
            if (Word(file, ref at) != "P6") throw new FormatException("The picture is no binary PPM file");
            width = int.Parse(Word(file, ref at));
            height = int.Parse(Word(file, ref at));
            if (Word(file, ref at) != "255") throw new FormatException("The picture does not have 8 bits to a colour");
            // A single white-space byte separates the last number from the pixels.
            at++;
            var pixels = new byte[checked(4 * width * height)];
            for (int i = 0; i < width * height; i++)
            {
                pixels[4 * i] = file[at + 3 * i];
                pixels[4 * i + 1] = file[at + 3 * i + 1];
                pixels[4 * i + 2] = file[at + 3 * i + 2];
                pixels[4 * i + 3] = 255;
            }
            return pixels;
        }

        private static string Word(byte[] file, ref int at)
        {
            while (char.IsWhiteSpace((char)file[at])) at++;
            int start = at;
            while (!char.IsWhiteSpace((char)file[at])) at++;
            return System.Text.Encoding.ASCII.GetString(file, start, at - start);
        }
    }
}
