// Which pixels are filled.

bool is_trusted(uint2 at)
{
    return Work.Load(AtTrusted + 4 * (at.y * Level.x + at.x)) != 0;
}

// Whether an untrusted pixel copies the one above: in large pictures only every second row is filled.
bool copies_above(uint2 at)
{
    return Halvings != 0 && (at.y & 1) != 0 && !is_trusted(at) && !is_trusted(at - uint2(0, 1));
}

bool is_filled(uint2 at)
{
    return !is_trusted(at) && !copies_above(at);
}

// Whether it is the mean of its left and right neighbours, which are filled.
bool is_interpolated(uint2 at)
{
    uint of_run = at.x & 31;
    bool is_inner = (of_run & 1) != 0 && of_run != 31 && at.x + 1 < Level.x;
    return is_inner && is_filled(at) && is_filled(at - uint2(1, 0)) && is_filled(at + uint2(1, 0));
}
