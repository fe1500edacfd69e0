#include "graph.hpp"

#include <algorithm>
#include <cairn.hpp>
#include <cstdio>
#include <cstring>

/* Pixels per millisecond: the graph's height is 51.2 ms. */
static constexpr float SCALE = 1.25f;

/* Bitmaps of the ten digits and the decimal point, three pixels wide and five high: three bits, an octal digit, for each row. */
static constexpr std::uint16_t GLYPHS[] = {075557, 026227, 071747, 071717, 055711, 074717, 074757, 071111, 075757, 075717, 000002};

graph::graph(gpu &gpu, colours colours, std::uint32_t white_nits) : format_(format_of(colours))
{
    /* sRGB, red in the lowest byte. */
    static constexpr std::uint32_t levels[INKS] = {0x201810, 0x706050, 0xFFFFFF, 0xF0F0F0, 0xF0C040, 0x60C850, 0x30D0F0, 0x4040E0};
    for (int i = 0; i < INKS; i++) inks_[i] = pixel_of(colours, levels[i], white_nits);
    for (com<ID3D12Resource> &memory : memory_) {
        memory = make_buffer(gpu.device(), std::uint64_t{WIDTH} * format_.bytes * HEIGHT, D3D12_HEAP_TYPE_UPLOAD);
    }
}

graph::ink graph::ink_of(std::uint32_t source)
{
    switch (source) {
    case CAIRN_FRAME_ANCHOR: return ANCHOR;
    case CAIRN_FRAME_DECODED: return DECODED;
    case CAIRN_FRAME_GENERATED: return GENERATED;
    case CAIRN_FRAME_EXTRAPOLATED: return EXTRAPOLATED;
    default: return HELD;
    }
}

void graph::set_pixel(unsigned char *rows, std::uint32_t x, std::uint32_t y, ink ink) const
{
    std::memcpy(rows + (std::size_t{y} * WIDTH + x) * format_.bytes, &inks_[ink], format_.bytes);
}

void graph::draw_text(unsigned char *rows, std::uint32_t left, std::uint32_t top, const char *text) const
{
    for (; *text != '\0'; text++, left += 8) {
        const std::uint16_t glyph = *text == '.' ? GLYPHS[10] : *text >= '0' && *text <= '9' ? GLYPHS[*text - '0'] : 0;
        for (std::uint32_t y = 0; y < 10; y++) {
            for (std::uint32_t x = 0; x < 6; x++) {
                if ((glyph >> ((4 - y / 2) * 3 + 2 - x / 2) & 1) != 0) set_pixel(rows, left + x, top + y, NUMBER);
            }
        }
    }
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
    for (const bar &entry : bars_) {
        if (entry.source != 0) sorted[count++] = entry.milliseconds;
    }
    std::sort(sorted, sorted + count);
    return count > 0 ? sorted[count / 2] : 0;
}

void graph::draw(unsigned char *rows) const
{
    for (std::uint32_t y = 0; y < HEIGHT; y++) {
        const float above = static_cast<float>(HEIGHT - 1 - y) / SCALE;
        const bool line = static_cast<int>(above * 60 / 1000) != static_cast<int>((above + 1 / SCALE) * 60 / 1000);
        for (std::uint32_t x = 0; x < WIDTH; x++) set_pixel(rows, x, y, line && x < BARS * 2 ? LINE : BACK);
    }
    for (std::uint32_t i = 0; i < BARS; i++) {
        const bar &shown = bars_[(next_ + i) % BARS];
        const std::uint32_t height = std::min(static_cast<std::uint32_t>(shown.milliseconds * SCALE), HEIGHT);
        for (std::uint32_t y = HEIGHT - height; y < HEIGHT; y++) {
            set_pixel(rows, i * 2, y, ink_of(shown.source));
            set_pixel(rows, i * 2 + 1, y, ink_of(shown.source));
        }
    }
    char text[8];
    std::snprintf(text, sizeof text, "%5.1f", static_cast<double>(std::min(median(), 999.9f)));
    draw_text(rows, NUMBER_AT, HEIGHT - 14, text);
}

void graph::record(gpu &gpu, ID3D12GraphicsCommandList *list, ID3D12Resource *target, std::uint32_t width, std::uint32_t height)
{
    constexpr std::uint32_t margin = 8;
    if (width < WIDTH + margin || height < HEIGHT + margin) return;
    ID3D12Resource *memory = memory_[gpu.slot()].Get();
    const D3D12_RANGE nothing = {0, 0};
    void *rows = nullptr;
    check(memory->Map(0, &nothing, &rows), "ID3D12Resource::Map");
    draw(static_cast<unsigned char *>(rows));
    memory->Unmap(0, nullptr);
    const D3D12_TEXTURE_COPY_LOCATION to = texture_location(target), from = buffer_location(memory, format_.format, WIDTH, HEIGHT, WIDTH * format_.bytes);
    list->CopyTextureRegion(&to, margin, height - HEIGHT - margin, 0, &from, nullptr);
}
