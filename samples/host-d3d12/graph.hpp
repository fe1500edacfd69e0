/* The frame-time graph: filled by the processor, copied into the picture. */
#ifndef HOST_D3D12_GRAPH_HPP
#define HOST_D3D12_GRAPH_HPP

#include "colours.hpp"
#include "gpu.hpp"

/* One bar for each of the last frames, as high as the time to it was long. */
class graph {
public:
    static constexpr std::uint32_t WIDTH = 256, HEIGHT = 64;

    /* For frames of these colours. */
    graph(gpu &gpu, colours colours, std::uint32_t white_nits);

    /* A frame of a source, CAIRN_FRAME_ANCHOR and so on, came `milliseconds` after the one before. */
    void add(float milliseconds, std::uint32_t source);
    /* Records the copy into a target of that size, in state COPY_DEST; into one that is too small nothing. */
    void record(gpu &gpu, ID3D12GraphicsCommandList *list, ID3D12Resource *target, std::uint32_t width, std::uint32_t height);

private:
    /* Two pixels wide each, beside the number. */
    static constexpr std::uint32_t BARS = 104, NUMBER_AT = 212;
    /* What is drawn with: the ground, the lines, the number, and a bar of each source. */
    enum ink { BACK, LINE, NUMBER, ANCHOR, DECODED, GENERATED, EXTRAPOLATED, HELD, INKS };
    struct bar {
        float milliseconds;
        std::uint32_t source;
    };

    static ink ink_of(std::uint32_t source);
    void put(unsigned char *rows, std::uint32_t x, std::uint32_t y, ink ink) const;
    void write(unsigned char *rows, std::uint32_t left, std::uint32_t top, const char *text) const;
    void draw(unsigned char *rows) const;
    float median() const;

    bar bars_[BARS] = {};
    std::uint32_t next_ = 0;
    const frame_format &format_;
    /* Each as frames have it. */
    std::uint64_t inks_[INKS] = {};
    com<ID3D12Resource> memory_[FRAMES_IN_FLIGHT];
};

#endif
