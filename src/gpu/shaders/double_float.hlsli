// Double-float arithmetic: a value is the unevaluated sum of two floats, about 48 bits (Dekker 1971, Knuth TAOCP 4.2.2).

float2 two_sum(float a, float b)
{
    precise float s = a + b;
    precise float v = s - a;
    precise float rest = (a - (s - v)) + (b - v);
    return float2(s, rest);
}

float2 two_product(float a, float b)
{
    precise float p = a * b;
    precise float wide_a = 4097 * a;
    precise float high_a = wide_a - (wide_a - a);
    precise float low_a = a - high_a;
    precise float wide_b = 4097 * b;
    precise float high_b = wide_b - (wide_b - b);
    precise float low_b = b - high_b;
    precise float rest = ((high_a * high_b - p) + high_a * low_b + low_a * high_b) + low_a * low_b;
    return float2(p, rest);
}

// Exact sum for |a| >= |b|.
float2 fast_two_sum(float a, float b)
{
    precise float s = a + b;
    precise float rest = b - (s - a);
    return float2(s, rest);
}

float2 added(float2 a, float2 b)
{
    float2 s = two_sum(a.x, b.x);
    precise float rest = s.y + (a.y + b.y);
    return fast_two_sum(s.x, rest);
}

float2 multiplied(float2 a, float2 b)
{
    float2 p = two_product(a.x, b.x);
    precise float rest = p.y + (a.x * b.y + a.y * b.x);
    return fast_two_sum(p.x, rest);
}

float2 divided(float2 a, float2 b)
{
    precise float q = a.x / b.x;
    float2 rest = added(a, -multiplied(b, float2(q, 0)));
    precise float more = rest.x / b.x;
    return fast_two_sum(q, more);
}

float2 root(float2 a)
{
    precise float r = sqrt(a.x);
    float2 rest = added(a, -two_product(r, r));
    precise float more = rest.x / (2 * r);
    return r > 0 ? fast_two_sum(r, more) : float2(r, 0);
}
