using System.Runtime.CompilerServices;

[assembly: InternalsVisibleTo("Cairn.Tests")]
