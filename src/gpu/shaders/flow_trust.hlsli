// Which pixels are filled.

bool is_trusted(uint2 at)
{
    return Work.Load(AtTrusted + 4 * (at.y * Level.x + at.x)) != 0;
}

// Whether a pixel that is not trusted is as that above it: in a large picture a fill does for the row below as well.
bool is_as_above(uint2 at)
{
    return Halvings != 0 && (at.y & 1) != 0 && !is_trusted(at) && !is_trusted(at - uint2(0, 1));
}

bool is_wanted(uint2 at)
{
    return !is_trusted(at) && !is_as_above(at);
}

// Whether it lies between two others that are filled, of which it takes the mean.
bool is_mean(uint2 at)
{
    uint of_run = at.x & 31;
    bool is_inner = (of_run & 1) != 0 && of_run != 31 && at.x + 1 < Level.x;
    return is_inner && is_wanted(at) && is_wanted(at - uint2(1, 0)) && is_wanted(at + uint2(1, 0));
}
