using System.Runtime.CompilerServices;

[assembly: InternalsVisibleTo("Cairn.Tests")]
// The Unity package compiles these files unchanged, next to its own.
[assembly: InternalsVisibleTo("Cairn.Unity")]
