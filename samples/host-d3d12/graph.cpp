#include "graph.hpp"

#include <algorithm>
#include <cairn.hpp>
#include <cstdio>

using colour = std::uint32_t; /* as bytes in memory: red is the lowest */

static constexpr colour BACK = 0xFF201810, LINE = 0xFF706050, INK = 0xFFFFFFFF;
/* Pixels for a millisecond: the panel is 51.2 ms high. */
static constexpr float SCALE = 1.25f;

static colour colour_of(std::uint32_t source)
{
    switch (source) {
    case CAIRN_FRAME_ANCHOR: return 0xFFF0F0F0;
    case CAIRN_FRAME_DECODED: return 0xFFF0C040;
    case CAIRN_FRAME_GENERATED: return 0xFF60C850;
    case CAIRN_FRAME_EXTRAPOLATED: return 0xFF30D0F0;
    default: return 0xFF4040E0;
    }
}

/* Digits and a point, three pixels wide and five high, a row in three bits. */
static constexpr std::uint16_t GLYPHS[] = {075557, 026227, 071747, 071717, 055711, 074717, 074757, 071111, 075757, 075717, 000002};

static void write(unsigned char *rows, std::uint32_t pitch, std::uint32_t left, std::uint32_t top, const char *text)
{
    for (; *text != '\0'; text++, left += 8) {
        const std::uint16_t glyph = *text == '.' ? GLYPHS[10] : *text >= '0' && *text <= '9' ? GLYPHS[*text - '0'] : 0;
        for (std::uint32_t y = 0; y < 10; y++) {
            for (std::uint32_t x = 0; x < 6; x++) {
                const bool on = (glyph >> ((4 - y / 2) * 3 + 2 - x / 2) & 1) != 0;
                if (on) reinterpret_cast<colour *>(rows + (top + y) * pitch)[left + x] = INK;
            }
        }
    }
}

graph::graph(gpu &gpu)
{
    for (com<ID3D12Resource> &memory : memory_) memory = make_buffer(gpu.device(), PITCH * HEIGHT, D3D12_HEAP_TYPE_UPLOAD);
}

void graph::add(float milliseconds, std::uint32_t source)
{
    bars_[next_] = {milliseconds, source};
    next_ = (next_ + 1) % BARS;
}

float graph::median() const
{
    float sorted[BARS];
    std::size_t count = 0;
    for (const bar &one : bars_) {
        if (one.source != 0) sorted[count++] = one.milliseconds;
    }
    std::sort(sorted, sorted + count);
    return count > 0 ? sorted[count / 2] : 0;
}

void graph::draw(unsigned char *rows) const
{
    const auto pixel = [&](std::uint32_t x, std::uint32_t y) -> colour & { return reinterpret_cast<colour *>(rows + y * PITCH)[x]; };
    for (std::uint32_t y = 0; y < HEIGHT; y++) {
        const float above = static_cast<float>(HEIGHT - 1 - y) / SCALE;
        const bool line = static_cast<int>(above * 60 / 1000) != static_cast<int>((above + 1 / SCALE) * 60 / 1000);
        for (std::uint32_t x = 0; x < WIDTH; x++) pixel(x, y) = line && x < BARS * 2 ? LINE : BACK;
    }
    for (std::uint32_t i = 0; i < BARS; i++) {
        const bar &shown = bars_[(next_ + i) % BARS];
        const std::uint32_t height = std::min(static_cast<std::uint32_t>(shown.milliseconds * SCALE), HEIGHT);
        for (std::uint32_t y = HEIGHT - height; y < HEIGHT; y++) pixel(i * 2, y) = pixel(i * 2 + 1, y) = colour_of(shown.source);
    }
    char text[8];
    std::snprintf(text, sizeof text, "%5.1f", static_cast<double>(std::min(median(), 999.9f)));
    write(rows, PITCH, NUMBER_AT, HEIGHT - 14, text);
}

void graph::record(gpu &gpu, ID3D12GraphicsCommandList *list, ID3D12Resource *target, std::uint32_t width, std::uint32_t height)
{
    constexpr std::uint32_t margin = 8;
    if (width < WIDTH + margin || height < HEIGHT + margin) return;
    ID3D12Resource *memory = memory_[gpu.slot()].Get();
    const D3D12_RANGE nothing = {0, 0};
    void *rows = nullptr;
    worked(memory->Map(0, &nothing, &rows), "ID3D12Resource::Map");
    draw(static_cast<unsigned char *>(rows));
    memory->Unmap(0, nullptr);
    const D3D12_TEXTURE_COPY_LOCATION to = picture_of(target), from = rows_of(memory, WIDTH, HEIGHT, PITCH);
    list->CopyTextureRegion(&to, margin, height - HEIGHT - margin, 0, &from, nullptr);
}
