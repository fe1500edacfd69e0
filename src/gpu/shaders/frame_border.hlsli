// Runs of foreground that a border cuts off: of rows, then of columns, each with its near and its far end. An entry has the number of
// pixels and the foreground's key.

int2 pixel_of_run(uint line_index, uint axis, bool is_far, int step)
{
    int along = is_far ? int(axis == 0 ? Size.x : Size.y) - 1 - step : step;
    return axis == 0 ? int2(along, line_index) : int2(line_index, along);
}

// Key of border foreground at a pixel, else EMPTY.
uint2 border_key(int2 at)
{
    uint2 rows = uint2(2 * at.y, 2 * at.y + 1);
    uint2 columns = 2 * Size.y + uint2(2 * at.x, 2 * at.x + 1);
    int2 end = int2(Size) - 1;
    uint4 lines = uint4(rows, columns);
    int4 steps = int4(at.x, end.x - at.x, at.y, end.y - at.y);
    for (uint i = 0; i < 4; i++)
    {
        uint3 run = Small.Load3(AtJoined + 16 * lines[i]);
        if (steps[i] < int(run.x))
        {
            return run.yz;
        }
    }
    return EMPTY;
}
