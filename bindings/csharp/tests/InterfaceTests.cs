using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using System.Reflection;
using System.Runtime.CompilerServices;
using System.Runtime.InteropServices;

namespace Cairn.Tests
{
    /// <summary>Compares the declarations with abi.txt, the list of the C interface.</summary>
    internal static class InterfaceTests
    {
        private const BindingFlags All = BindingFlags.NonPublic | BindingFlags.Public | BindingFlags.Instance | BindingFlags.Static;

        private static string[][] Lines(string kind)
        {
            string[] record = File.ReadAllLines(Program.Setting("CAIRN_TEST_RECORD"));
            string[][] found = record.Where(line => line.StartsWith(kind + " ")).Select(line => line.Split(' ').Skip(1).ToArray()).ToArray();
            Expect.True(found.Length > 0, $"abi.txt has no {kind}");
            return found;
        }

        private static Type Struct(string name)
        {
            return typeof(Native).GetNestedType(name.Substring("cairn_".Length), All);
        }

        [Test]
        private static void ConstantsMatchAbiTxt()
        {
            string[][] recorded = Lines("constant");
            foreach (string[] line in recorded)
            {
                FieldInfo field = typeof(Native).GetField(line[0].Substring("CAIRN_".Length), All);
                Expect.True(field != null, $"there is no {line[0]}");
                // The table lists the infinite timeout as a signed number.
                long value = field.FieldType == typeof(ulong) ? (long)(ulong)field.GetRawConstantValue() : (int)field.GetRawConstantValue();
                Expect.Equal(long.Parse(line[1]), value, line[0]);
            }
            Expect.Equal(recorded.Length, typeof(Native).GetFields(All).Length, "the number of constants");
        }

        [Test]
        private static void StructLayoutsMatchAbiTxt()
        {
            string[][] fields = Lines("field");
            // If there are several sizes, the last one is current.
            Dictionary<string, int> sizes = Lines("size").GroupBy(line => line[0]).ToDictionary(each => each.Key, each => int.Parse(each.Last()[1]));
            var compared = 0;
            foreach (string name in sizes.Keys)
            {
                Type type = Struct(name);
                if (type == null) continue;
                Expect.Equal(sizes[name], Marshal.SizeOf(type), $"the size of {name}");
                string[][] own = fields.Where(line => line[0].StartsWith(name + ".")).ToArray();
                FieldInfo[] declared = type.GetFields(All).OrderBy(field => field.MetadataToken).ToArray();
                Expect.Equal(own.Length, declared.Length, $"the number of fields of {name}");
                for (int i = 0; i < own.Length; i++)
                {
                    Expect.Equal(own[i][0], $"{name}.{declared[i].Name}", "a field");
                    Expect.Equal(int.Parse(own[i][1]), (int)Marshal.OffsetOf(type, declared[i].Name), $"the place of {own[i][0]}");
                    Expect.Equal(int.Parse(own[i][2]), SizeOf(declared[i]), $"the size of {own[i][0]}");
                    compared++;
                }
            }
            Expect.True(compared > 200, $"only {compared} fields were compared");
        }

        private static int SizeOf(FieldInfo field)
        {
            var array = field.GetCustomAttribute<FixedBufferAttribute>();
            if (array != null) return Marshal.SizeOf(array.ElementType) * array.Length;
            return field.FieldType.IsPointer ? IntPtr.Size : Marshal.SizeOf(field.FieldType);
        }

        /// <summary>The C type of each parameter, from "cairn_result name(TYPE a, TYPE b)".</summary>
        private static string[] Parameters(string prototype)
        {
            string inside = prototype.Substring(prototype.IndexOf('(') + 1).TrimEnd(')');
            if (inside == "void") return new string[0];
            return inside.Split(',').Select(each => each.Substring(0, each.LastIndexOfAny(new[] { ' ', '*' }) + 1).Replace("const ", "").Replace("struct ", "").Trim()).ToArray();
        }

        private static Type Of(string c)
        {
            var plain = new Dictionary<string, Type>
            {
                ["uint32_t"] = typeof(uint), ["int32_t"] = typeof(int), ["uint64_t"] = typeof(ulong), ["size_t"] = typeof(UIntPtr), ["float"] = typeof(float),
                ["cairn_result"] = typeof(int), ["void"] = typeof(void), ["char"] = typeof(byte), ["uint8_t"] = typeof(byte), ["uint16_t"] = typeof(ushort),
                ["cairn_log_callback"] = typeof(IntPtr),
            };
            int stars = c.Count(letter => letter == '*');
            string name = c.Replace("*", "").Trim();
            Type type;
            if (!plain.TryGetValue(name, out type)) type = Struct(name);
            if (type == null)
            {
                // A handle is a number.
                Expect.True(name.StartsWith("cairn_") && stars > 0, $"an unknown type: {c}");
                type = typeof(IntPtr);
                stars--;
            }
            for (; stars > 0; stars--) type = type.MakePointerType();
            return type;
        }

        [Test]
        private static void FunctionSignaturesMatchAbiTxt()
        {
            var recorded = new HashSet<string>();
            foreach (string line in Lines("function").Select(words => string.Join(" ", words)))
            {
                string head = line.Substring(0, line.IndexOf('('));
                string name = head.Substring(head.LastIndexOfAny(new[] { ' ', '*' }) + 1);
                string answer = head.Substring(0, head.Length - name.Length).Replace("const ", "").Trim();
                FieldInfo field = typeof(Native.Functions).GetField(name.Substring("cairn_".Length), All);
                Expect.True(field != null, $"there is no {name}");
                MethodInfo method = field.FieldType.GetMethod("Invoke");
                Expect.Equal(Of(answer), method.ReturnType, $"the result of {name}");
                Type[] own = method.GetParameters().Select(each => each.ParameterType).ToArray();
                Type[] wanted = Parameters(line).Select(Of).ToArray();
                Expect.True(own.SequenceEqual(wanted), $"{name} takes {string.Join<Type>(", ", own)}, not {string.Join<Type>(", ", wanted)}");
                var convention = field.FieldType.GetCustomAttribute<UnmanagedFunctionPointerAttribute>();
                Expect.Equal(CallingConvention.Cdecl, convention.CallingConvention, name);
                recorded.Add(field.Name);
            }
            var declared = new HashSet<string>(typeof(Native.Functions).GetFields(All).Select(field => field.Name));
            Expect.True(declared.SetEquals(recorded), "functions are not those of the record: " + string.Join(", ", declared.Except(recorded)));
        }

        [Test(OnDotNet = true)]
        private static void OnlyTypesOfNetstandardAreUsed()
        {
            // The assembly forwards all of its types to others.
            MethodInfo forwarded = typeof(Assembly).GetMethod("GetForwardedTypes", Type.EmptyTypes);
            var standard = new HashSet<Type>((Type[])forwarded.Invoke(Assembly.Load("netstandard"), null));
            Module module = typeof(Library).Module;
            var used = 0;
            try
            {
                // The table of referenced types.
                for (int token = 0x01000001; ; token++, used++)
                {
                    Type type = module.ResolveType(token);
                    Expect.True(type.IsNested || standard.Contains(type), $"{type} is not in netstandard");
                }
            }
            catch (ArgumentOutOfRangeException)
            {
                Expect.True(used > 30, $"only {used} types were looked at");
            }
        }

        [Test]
        private static void EnumerationsNameEveryConstant()
        {
            CheckNames<LogLevel>("LOG_");
            string[] options = { "DEVICE_DETERMINISTIC", "DEVICE_ENVIRONMENT" };
            CheckNames<DeviceKind>("DEVICE_", without: options);
            CheckFlagProperties<DeviceOptions>("DEVICE_", "", options);
            CheckNames<Precision>("PRECISION_", "Best");
            CheckNames<LoadStage>("LOAD_");
            CheckNames<PixelFormat>("FORMAT_");
            CheckNames<MotionSource>("MOTION_");
            CheckNames<DepthKind>("DEPTH_", "Device");
            CheckNames<Preference>("PREFER_");
            CheckNames<ColourSpace>("COLOUR_");
            string[] flags = { "FRAME_CUT", "FRAME_REPEATED", "FRAME_UNPREPARED" };
            CheckNames<FrameSource>("FRAME_", without: flags);
            CheckFlagProperties<Frame>("FRAME_", "Is", flags);
            string[] statuses = { "REQUIREMENT_MET", "REQUIREMENT_NOT_MET", "REQUIREMENT_UNKNOWN", "REQUIREMENT_OPTIONAL" };
            CheckNames<RequirementKind>("REQUIREMENT_", without: statuses);
            Expect.Equal(statuses.Length, Enum.GetNames(typeof(RequirementStatus)).Length);
            CheckNames<Result>("ERROR_", "Ok", "NotReady", "Truncated", "QueueFull");
        }

        [Test]
        private static void StructsHaveAPropertyForEveryField()
        {
            CheckProperties<Native.device_options, DeviceOptions>("flags");
            CheckProperties<Native.device_info, DeviceInfo>();
            CheckProperties<Native.adapter, Adapter>();
            CheckProperties<Native.requirement, Requirement>("what");
            CheckProperties<Native.world_options, WorldOptions>("flags", "user");
            CheckProperties<Native.world_info, WorldInfo>();
            CheckProperties<Native.world_memory, WorldMemory>();
            CheckProperties<Native.anchor_info, AnchorInfo>("flags");
            CheckProperties<Native.rollout_options, RolloutOptions>();
            CheckProperties<Native.rollout_info, RolloutInfo>();
            CheckProperties<Native.rollout_statistics, RolloutStatistics>();
            CheckProperties<Native.step_info, StepInfo>("flags");
            CheckProperties<Native.guidance_info, GuidanceInfo>();
            CheckProperties<Native.presenter_options, PresenterOptions>("flags");
            CheckProperties<Native.presenter_statistics, PresenterStatistics>();
            CheckProperties<Native.frame, Frame>("flags");
            CheckProperties<Native.budget, Budget>("world_count");
        }

        /// <summary>Checks that each field except those in besides has a property of its name. Flags are several properties.</summary>
        private static void CheckProperties<TNative, TPublic>(params string[] besides)
        {
            IEnumerable<string> properties = typeof(TPublic).GetProperties().Select(property => property.Name.ToLowerInvariant());
            IEnumerable<string> fields = typeof(TNative).GetFields(All).Select(field => field.Name);
            foreach (string field in fields.Where(name => name != "struct_size" && !name.StartsWith("reserved") && !besides.Contains(name)))
            {
                Expect.True(properties.Contains(field.Replace("_", "")), $"{typeof(TPublic).Name} has no property for {field}");
            }
        }

        /// <summary>Checks that each flag has a Boolean property.</summary>
        private static void CheckFlagProperties<T>(string prefix, string verb, string[] flags)
        {
            foreach (string flag in flags)
            {
                string name = verb + flag.Substring(prefix.Length).Replace("_", "");
                PropertyInfo property = typeof(T).GetProperties().FirstOrDefault(each => string.Equals(each.Name, name, StringComparison.OrdinalIgnoreCase));
                Expect.True(property != null && property.PropertyType == typeof(bool), $"{typeof(T).Name} has no property for {flag}");
            }
        }

        private static void CheckNames<T>(string prefix, params string[] besides)
        {
            CheckNames<T>(prefix, new string[0], besides);
        }

        private static void CheckNames<T>(string prefix, string[] without, params string[] besides)
        {
            IEnumerable<FieldInfo> constants = typeof(Native).GetFields(All).Where(field => field.Name.StartsWith(prefix) && !without.Contains(field.Name));
            foreach (FieldInfo constant in constants)
            {
                string name = Enum.GetName(typeof(T), constant.GetRawConstantValue());
                string expected = constant.Name.Substring(prefix.Length).Replace("_", "");
                Expect.True(string.Equals(name, expected, StringComparison.OrdinalIgnoreCase), $"{typeof(T).Name} calls {constant.Name} {name}");
            }
            Expect.Equal(constants.Count() + besides.Length, Enum.GetNames(typeof(T)).Length, $"the number of names of {typeof(T).Name}");
            Expect.True(besides.All(name => Enum.IsDefined(typeof(T), name)), $"{typeof(T).Name} lacks a name");
        }
    }
}
