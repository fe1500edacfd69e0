/* The frame-time graph: the processor draws it, and the device copies it into the frame. */
#ifndef HOST_D3D12_GRAPH_HPP
#define HOST_D3D12_GRAPH_HPP

#include "colours.hpp"
#include "gpu.hpp"

/* One bar for each of the last frames; its height is the time since the frame before. */
class graph {
public:
    static constexpr std::uint32_t WIDTH = 256, HEIGHT = 64;

    /* For frames of these colours. */
    graph(gpu &gpu, colours colours, std::uint32_t white_nits);

    /* Adds a frame, `milliseconds` after the one before; `source` is CAIRN_FRAME_ANCHOR and so on. */
    void add(float milliseconds, std::uint32_t source);
    /* Records the copy into a target of that size, in state COPY_DEST. Records nothing if the target is too small. */
    void record(gpu &gpu, ID3D12GraphicsCommandList *list, ID3D12Resource *target, std::uint32_t width, std::uint32_t height);

private:
    /* The number of bars, two pixels wide each, and the left edge of the number beside them. */
    static constexpr std::uint32_t BARS = 104, NUMBER_AT = 212;
    /* The colours: background, lines, number, and a bar's colour for each source. */
    enum ink { BACK, LINE, NUMBER, ANCHOR, DECODED, GENERATED, EXTRAPOLATED, HELD, INKS };
    struct bar {
        float milliseconds;
        std::uint32_t source;
    };

    static ink ink_of(std::uint32_t source);
    void set_pixel(unsigned char *rows, std::uint32_t x, std::uint32_t y, ink ink) const;
    void draw_text(unsigned char *rows, std::uint32_t left, std::uint32_t top, const char *text) const;
    void draw(unsigned char *rows) const;
    float median() const;

    bar bars_[BARS] = {};
    std::uint32_t next_ = 0;
    const frame_format &format_;
    /* Each colour as a pixel of the frame's format. */
    std::uint64_t inks_[INKS] = {};
    com<ID3D12Resource> memory_[FRAMES_IN_FLIGHT];
};

#endif
