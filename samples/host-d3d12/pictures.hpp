/* Picture files: PPM (P6), and PFM for values above white. */
#ifndef HOST_D3D12_PICTURES_HPP
#define HOST_D3D12_PICTURES_HPP

#include <cstdint>
#include <string>
#include <vector>

/* Red, green, blue and alpha of each pixel, rows from top to bottom. */
struct image {
    std::uint32_t width = 0, height = 0;
    std::vector<unsigned char> rgba;

    image() = default;
    image(std::uint32_t w, std::uint32_t h) : width(w), height(h), rgba(std::size_t{w} * h * 4) {}
};

/* Paths are UTF-8. A failure throws std::runtime_error with the path, the cause and what to do. */
image read_ppm(const std::string &path);
void write_ppm(const std::string &path, const image &image);
/* Writes pixels of R10G10B10A2 as a PPM with a maximum of 1023: two bytes for each number, the higher first. */
void write_ppm_of_ten(const std::string &path, std::uint32_t width, std::uint32_t height, const std::vector<unsigned char> &pixels);
/* Writes pixels of four half floats as a PFM, without alpha: single floats in little-endian order, the lowest row first. */
void write_pfm(const std::string &path, std::uint32_t width, std::uint32_t height, const std::vector<unsigned char> &pixels);
void write_text(const std::string &path, const std::string &text);
std::string read_text(const std::string &path);
/* Creates a folder and its parents. */
void make_folder(const std::string &path);
/* The path of a file beside this program. */
std::string beside_program(const char *name);

#endif
