/* The frame-time graph: filled by the processor, copied into the picture. */
#ifndef HOST_D3D12_GRAPH_HPP
#define HOST_D3D12_GRAPH_HPP

#include "gpu.hpp"

/* One bar for each of the last frames, as high as the time to it was long. */
class graph {
public:
    static constexpr std::uint32_t WIDTH = 256, HEIGHT = 64;

    explicit graph(gpu &gpu);

    /* A frame of a source, CAIRN_FRAME_ANCHOR and so on, came `milliseconds` after the one before. */
    void add(float milliseconds, std::uint32_t source);
    /* Records the copy into a target of that size, in state COPY_DEST; into one that is too small nothing. */
    void record(gpu &gpu, ID3D12GraphicsCommandList *list, ID3D12Resource *target, std::uint32_t width, std::uint32_t height);

private:
    /* Two pixels wide each, beside the number. */
    static constexpr std::uint32_t BARS = 104, NUMBER_AT = 212, PITCH = WIDTH * 4;
    struct bar {
        float milliseconds;
        std::uint32_t source;
    };

    void draw(unsigned char *rows) const;
    float median() const;

    bar bars_[BARS] = {};
    std::uint32_t next_ = 0;
    com<ID3D12Resource> memory_[FRAMES_IN_FLIGHT];
};

#endif
