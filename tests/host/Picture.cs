// One step in the embedded world from C#: `Picture FILE` writes the resulting picture (PPM).
using System;
using System.IO;
using System.Text;
using Cairn;

internal static class Picture
{
    private static int Main(string[] arguments)
    {
        if (arguments.Length != 1)
        {
            Console.Error.WriteLine("Picture FILE");
            return 2;
        }
        using (Device device = Device.Cpu())
        using (World world = device.LoadWorld(new WorldOptions { OperatingPoint = "stock,pictures:1" }))
        using (Rollout rollout = world.CreateRollout(new RolloutOptions { Seed = 1 }))
        {
            WorldInfo info = world.Info;
            var seed = new byte[info.RenderWidth * info.RenderHeight * 4]; // sky above, meadow below
            for (int i = 0; i < seed.Length; i += 4)
            {
                bool sky = i < seed.Length / 2;
                seed[i] = (byte)(sky ? 110 : 70);
                seed[i + 1] = (byte)(sky ? 160 : 110);
                seed[i + 2] = (byte)(sky ? 220 : 50);
                seed[i + 3] = 255;
            }
            rollout.Append(new PictureView(seed, info.RenderWidth, info.RenderHeight));
            rollout.Step(new Controls(Key.W));
            using (Anchor anchor = rollout.Anchor())
            {
                byte[] picture = anchor.Picture();
                using (var file = new FileStream(arguments[0], FileMode.Create))
                {
                    byte[] head = Encoding.ASCII.GetBytes($"P6\n{anchor.Info.Width} {anchor.Info.Height}\n255\n");
                    file.Write(head, 0, head.Length);
                    for (int i = 0; i < picture.Length; i += 4) file.Write(picture, i, 3);
                }
            }
        }
        return 0;
    }
}
