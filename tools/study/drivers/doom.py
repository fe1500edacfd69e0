"""A walk in ViZDoom: pictures, depth, what is no part of the world, and the camera, one of each for every tic.

    python doom.py MAP VIEW WALK FOLDER

MAP is a map of Freedoom 2, such as map02, or a scenario of ViZDoom, such as deadly_corridor.wad. VIEW is "world", the empty world without
anything drawn over it, or "player", with monsters, weapon, HUD, messages and effects, as a player sees it. WALK is a list of stretches,
SPEED:TURN:TICS with commas between: forward speed, degrees to the right for each tic, and number of tics.

The pictures are drawn at 1920x1080 and reduced to a third by their mean. FOLDER gets, tic by tic,

    pictures.rgb  640x360 pixels of 8-bit RGB
    depth.f32     map units along the view axis to the middle of each pixel, infinite for the sky
    world.u8      1 where all nine pixels behind one show walls, floors, ceilings and sky, 0 where a thing is among them
    camera.f64    x, y, z in map units and the angle in degrees, to the left from the x axis

ViZDoom's depth has steps of 7 map units on floors and of 16 on walls, too coarse to move a picture by. The map's lines and
heights, which it tells as well, say where in its step the depth lies; where the two do not agree, the step counts.
"""

import sys
from pathlib import Path

import numpy as np
import vizdoom

GAME = Path(vizdoom.__file__).parent
MAPS = GAME / "freedoom2.wad"
SEED = 1
DRAWN_OVER = ("hud", "weapon", "crosshair", "decals", "particles", "messages", "screen_flashes", "effects_sprites")

SHRINK = 3
WIDTH, HEIGHT = 640, 360
# Pixels to one unit of slope: 90 degrees seen on a screen of 4:3, whose pixels were a fifth higher than wide.
FOCAL = (240.0, 288.0)
CENTRE = (319.5, 179.5)
# Depth of value v: floors and ceilings lie at FLOOR[0] + (v to v + 1) * FLOOR[1]; walls are counted in steps of their own
# before they are scaled to the picture's height.
FLOOR = (10.925, 7.1593)
WALL = (24.25, 16.07, 1080 / 480)
SKY = 255
FLAT, UPRIGHT = 1, 2


def start(name: str, player: bool) -> vizdoom.DoomGame:
    """The game at the beginning of a map: as the player sees it, or without anything that is no part of the world."""
    game = vizdoom.DoomGame()
    game.set_doom_game_path(str(MAPS))
    if name.endswith(".wad"):
        game.set_doom_scenario_path(str(GAME / "scenarios" / name))
        game.set_doom_map("map01")
    else:
        game.set_doom_map(name)
    game.set_screen_resolution(vizdoom.ScreenResolution.RES_1920X1080)
    game.set_screen_format(vizdoom.ScreenFormat.RGB24)
    game.set_depth_buffer_enabled(True)
    game.set_labels_buffer_enabled(True)
    game.set_sectors_info_enabled(True)
    for what in DRAWN_OVER:
        getattr(game, f"set_render_{what}")(player)
    game.set_window_visible(False)
    game.set_sound_enabled(False)
    game.set_available_buttons([vizdoom.Button.MOVE_FORWARD_BACKWARD_DELTA, vizdoom.Button.TURN_LEFT_RIGHT_DELTA])
    variables = ("CAMERA_POSITION_X", "CAMERA_POSITION_Y", "CAMERA_POSITION_Z", "CAMERA_ANGLE")
    game.set_available_game_variables([getattr(vizdoom.GameVariable, name) for name in variables])
    game.set_seed(SEED)
    # Without bobbing the camera is where the game says it is.
    game.add_game_args("+movebob 0 +stillbob 0")
    if player:
        game.set_doom_skill(3)
        # Damage shows on the HUD and kills nobody: the walk goes on.
        game.add_game_args("+sv_cheats 1")
    else:
        game.add_game_args("-nomonsters")
    game.set_episode_timeout(100_000)
    game.init()
    if player:
        game.send_game_command("buddha")
    return game


class Plan:
    """The map from above: lines with the sectors on both sides, and the heights of every sector."""

    def __init__(self, sectors: list) -> None:
        sides: dict = {}
        for number, sector in enumerate(sectors):
            for line in sector.lines:
                ends = (line.x1, line.y1), (line.x2, line.y2)
                sides.setdefault((min(ends), max(ends)), []).append(number)
        self.lines = np.array(list(sides), float)
        self.sides = np.array([(found + [-1])[:2] for found in sides.values()])
        self.floors = np.array([sector.floor_height for sector in sectors], float)
        self.ceilings = np.array([sector.ceiling_height for sector in sectors], float)

    def sector(self, x: float, y: float, z: float) -> int:
        """The sector around a point: a ray from it leaves it once more than it enters it."""
        (x1, y1), (x2, y2) = self.lines[:, 0].T, self.lines[:, 1].T
        crosses = (y1 > y) != (y2 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            crosses &= x < x1 + (y - y1) * (x2 - x1) / (y2 - y1)
        # A line inside a sector has it on both sides and is no border.
        crosses &= self.sides[:, 0] != self.sides[:, 1]
        counts = np.bincount(self.sides[crosses].ravel() + 1, minlength=len(self.floors) + 1)[1:]
        found = np.nonzero((counts % 2 == 1) & (self.floors < z) & (z < self.ceilings))[0]
        return int(found[np.argmax(self.floors[found])]) if len(found) else -1

    def depth(self, camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Depth of every pixel, and whether it shows a flat or an upright surface (0: neither was found)."""
        x, y, z, angle = camera
        turn = np.deg2rad(angle)
        around = self.lines - camera[:2]
        ahead = around @ np.array([np.cos(turn), np.sin(turn)])
        right = around @ np.array([np.sin(turn), -np.cos(turn)])
        rise = (CENTRE[1] - np.arange(HEIGHT)) / FOCAL[1]
        depth = np.full((HEIGHT, WIDTH), np.inf)
        kind = np.zeros((HEIGHT, WIDTH), np.uint8)
        # A place on a line belongs to neither side.
        first = self.sector(x + 1e-3, y + 1.7e-3, z)
        borders = self.sides[:, 0] != self.sides[:, 1]
        for column in range(WIDTH):
            slope = (column - CENTRE[0]) / FOCAL[0]
            off = right - slope * ahead
            with np.errstate(divide="ignore", invalid="ignore"):
                along = off[:, 0] / (off[:, 0] - off[:, 1])
            distance = ahead[:, 0] + along * (ahead[:, 1] - ahead[:, 0])
            met = np.nonzero(borders & (along >= 0) & (along <= 1) & (distance > 1e-6))[0]
            here, free = first, np.ones(HEIGHT, bool)
            for line in met[np.argsort(distance[met])]:
                if here not in self.sides[line]:
                    continue
                height = z + rise * distance[line]
                for plane, behind in ((self.floors[here], height < self.floors[here]),
                                      (self.ceilings[here], height > self.ceilings[here])):
                    seen = free & behind
                    depth[seen, column], kind[seen, column] = (plane - z) / rise[seen], FLAT
                    free &= ~seen
                there = self.sides[line][int(self.sides[line][0] == here)]
                passes = there >= 0 and (height >= self.floors[there]) & (height <= self.ceilings[there])
                seen = free & ~np.broadcast_to(passes, HEIGHT)
                depth[seen, column], kind[seen, column] = distance[line], UPRIGHT
                free &= ~seen
                here = there
                if here < 0 or not free.any():
                    break
        return depth, kind


def refine(values: np.ndarray, depth: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """The depth of 8-bit values: `depth` where it explains them, the middle of their step elsewhere."""
    flat = np.floor((depth - FLOOR[0]) / FLOOR[1])
    upright = np.floor(WALL[2] * np.floor((depth - WALL[0]) / WALL[1]))
    explained = (kind == FLAT) & (np.abs(flat.clip(0, SKY) - values) <= 1)
    explained |= (kind == UPRIGHT) & (np.abs(upright.clip(0, SKY) - values) <= WALL[2])
    middle = FLOOR[0] + (values + 0.5) * FLOOR[1]
    return np.where(values == SKY, np.inf, np.where(explained, depth, middle))


def main() -> None:
    name, view, stretches, folder = sys.argv[1], sys.argv[2], sys.argv[3], Path(sys.argv[4])
    walk = [[float(part) for part in stretch.split(":")] for stretch in stretches.split(",")]
    game = start(name, view == "player")
    files = [(folder / file).open("wb") for file in ("pictures.rgb", "depth.f32", "world.u8", "camera.f64")]
    for speed, turn, tics in walk:
        for _ in range(int(tics)):
            if game.is_episode_finished():
                sys.exit(f"{name} ended before the walk did")
            state = game.get_state()
            blocks = (HEIGHT, SHRINK, WIDTH, SHRINK)
            picture = state.screen_buffer.reshape(*blocks, 3).mean((1, 3))
            # Walls, floors and ceilings are labelled 0 and 1, things from 2.
            world = (state.labels_buffer <= 1).reshape(blocks).all((1, 3))
            middles = state.depth_buffer[SHRINK // 2 :: SHRINK, SHRINK // 2 :: SHRINK].astype(float)
            camera = np.array(state.game_variables, float)
            depth = refine(middles, *Plan(state.sectors).depth(camera))
            data = np.rint(picture).astype("u1"), depth.astype("<f4"), world.astype("u1"), camera.astype("<f8")
            for file, values in zip(files, data, strict=True):
                file.write(values.tobytes())
            game.make_action([speed, turn])
    for file in files:
        file.close()
    game.close()


if __name__ == "__main__":
    main()
