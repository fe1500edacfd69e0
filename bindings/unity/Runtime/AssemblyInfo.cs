using System.Runtime.CompilerServices;

[assembly: InternalsVisibleTo("Cairn.Unity.Editor")]
