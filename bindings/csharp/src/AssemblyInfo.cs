using System.Runtime.CompilerServices;

[assembly: InternalsVisibleTo("Cairn.Tests")]
// The Unity package compiles these files as they are, and its own beside them.
[assembly: InternalsVisibleTo("Cairn.Unity")]
