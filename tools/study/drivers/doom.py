"""A walk in ViZDoom: pictures, depth, what is no part of the world, and the camera, one of each for every tic.

    python doom.py MAP VIEW WALK FOLDER

MAP is a map of Freedoom 2, such as map02, or a scenario of ViZDoom, such as deadly_corridor.wad. VIEW is "world", the empty world without
anything drawn over it, or "player", with monsters, weapon, HUD, messages and effects, as a player sees it. WALK is a list of stretches,
SPEED:TURN:TICS with commas between: forward speed, degrees to the right for each tic, and number of tics.

The pictures are drawn at 1920x1080 and reduced to a third by their mean. FOLDER gets, tic by tic,

    pictures.rgb  640x360 pixels of 8-bit RGB
    depth.f32     map units along the view axis to the middle of each pixel, infinite for the sky
    world.u8      1 where all nine pixels behind one show walls, floors, ceilings and sky, 0 where a thing is among them
    thing.u8      the thing that the middle of each pixel shows: 0 for the world, 255 for weapon and status bar, which go with the view
    steps.f64     256 times x, y, z in map units: how far each thing has moved in the last two tics
    overlay.u8    255 where status bar and messages are drawn over the view, 0 elsewhere
    camera.f64    x, y, z in map units, the angle in degrees, to the left from the x axis, and the row straight ahead

ViZDoom's depth has steps of 7 map units on floors and of 16 on walls, too coarse to move a picture by. The map's lines and
heights, which it tells as well, say where in its step the depth lies; where the two do not agree, the step counts. Where they
disagree on more than a tenth of the surfaces, the walk is refused: then the camera is not where this program takes it to be.
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
CENTRE = 319.5
# Depth of value v: floors and ceilings lie at FLOOR[0] + (v to v + 1) * FLOOR[1]; walls are counted in steps of their own
# before they are scaled to the picture's height.
FLOOR = (10.925, 7.1593)
WALL = (24.25, 16.07, 1080 / 480)
SKY = 255
FLAT, UPRIGHT = 1, 2
# Values of the labels up to this are the world's; the weapon's is the largest.
WORLD, VIEW = 1, 255
MIN_EXPLAINED = 0.9


def start(name: str, player: bool, messages: bool) -> vizdoom.DoomGame:
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
        getattr(game, f"set_render_{what}")(player and (messages or what != "messages"))
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
        """The sector around a point: a ray to the right leaves it once more than it enters it, and its border is the first that is met."""
        (x1, y1), (x2, y2) = self.lines[:, 0].T, self.lines[:, 1].T
        # A line inside a sector has it on both sides and is no border.
        crosses = ((y1 > y) != (y2 > y)) & (self.sides[:, 0] != self.sides[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            met = x1 + (y - y1) * (x2 - x1) / (y2 - y1)
        crosses &= x < met
        if not crosses.any():
            return -1
        counts = np.bincount(self.sides[crosses].ravel() + 1, minlength=len(self.floors) + 1)[1:]
        nearest = self.sides[np.argmin(np.where(crosses, met, np.inf))]
        found = [side for side in nearest if side >= 0 and counts[side] % 2 == 1]
        found = [side for side in found if self.floors[side] < z < self.ceilings[side]]
        return int(found[0]) if found else -1

    def depth(self, camera: np.ndarray, middle: float) -> tuple[np.ndarray, np.ndarray]:
        """Depth of every pixel, and whether it shows a flat or an upright surface (0: neither was found).

        `middle` is the row straight ahead.
        """
        x, y, z, angle = camera
        turn = np.deg2rad(angle)
        around = self.lines - camera[:2]
        ahead = around @ np.array([np.cos(turn), np.sin(turn)])
        right = around @ np.array([np.sin(turn), -np.cos(turn)])
        rise = (middle - np.arange(HEIGHT)) / FOCAL[1]
        depth = np.full((HEIGHT, WIDTH), np.inf)
        kind = np.zeros((HEIGHT, WIDTH), np.uint8)
        # A place on a line belongs to neither side.
        first = self.sector(x + 1e-3, y + 1.7e-3, z)
        borders = self.sides[:, 0] != self.sides[:, 1]
        for column in range(WIDTH):
            slope = (column - CENTRE) / FOCAL[0]
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


def refine(values: np.ndarray, depth: np.ndarray, kind: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The depth of 8-bit values: `depth` where it explains them, the middle of their step elsewhere; and where it does."""
    flat = np.floor((depth - FLOOR[0]) / FLOOR[1])
    upright = np.floor(WALL[2] * np.floor((depth - WALL[0]) / WALL[1]))
    explained = (kind == FLAT) & (np.abs(flat.clip(0, SKY) - values) <= 1)
    explained |= (kind == UPRIGHT) & (np.abs(upright.clip(0, SKY) - values) <= WALL[2])
    middle = FLOOR[0] + (values + 0.5) * FLOOR[1]
    return np.where(values == SKY, np.inf, np.where(explained, depth, middle)), explained


class Things:
    """Monsters and what else stands about: pictures that face the camera, each at the depth of its place."""

    def __init__(self) -> None:
        self.before: list[dict] = [{}, {}]

    def look(self, labels: list, camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For each value of the labels: the thing's distance along the view axis, and its motion in the last two tics."""
        turn = np.deg2rad(camera[3])
        axis = np.array([np.cos(turn), np.sin(turn)])
        distances, steps, places = np.full(256, np.nan), np.zeros((256, 3)), {}
        for label in labels:
            place = np.array([getattr(label, f"object_position_{name}") for name in "xyz"])
            velocity = np.array([getattr(label, f"object_velocity_{name}") for name in "xyz"])
            if label.value in (WORLD, VIEW):
                continue
            places[label.object_id] = place
            distances[label.value] = (place[:2] - camera[:2]) @ axis
            # A thing that was not visible two tics ago is taken to have moved at its present velocity.
            steps[label.value] = place - self.before[0].get(label.object_id, place - 2 * velocity)
        self.before = [self.before[1], places]
        return distances, steps


def reduced(state: vizdoom.GameState) -> np.ndarray:
    """The picture at a third of its size."""
    blocks = (HEIGHT, SHRINK, WIDTH, SHRINK, 3)
    return np.rint(state.screen_buffer.reshape(blocks).mean((1, 3)))


def main() -> None:
    name, view, stretches, folder = sys.argv[1], sys.argv[2], sys.argv[3], Path(sys.argv[4])
    walk = [[float(part) for part in stretch.split(":")] for stretch in stretches.split(",")]
    player = view == "player"
    game = start(name, player, messages=True)
    # The same walk without messages shows where they are.
    silent = start(name, player, messages=False) if player else game
    planes = ("pictures.rgb", "depth.f32", "world.u8", "thing.u8", "steps.f64", "overlay.u8", "camera.f64")
    files = [(folder / file).open("wb") for file in planes]
    things, agreed = Things(), []
    inner = slice(SHRINK // 2, None, SHRINK)
    for speed, turn, tics in walk:
        for _ in range(int(tics)):
            if game.is_episode_finished():
                sys.exit(f"{name} ended before the walk did")
            state = game.get_state()
            picture = reduced(state)
            # Walls, floors and ceilings are labelled 0 and 1, things from 2.
            world = (state.labels_buffer <= WORLD).reshape(HEIGHT, SHRINK, WIDTH, SHRINK).all((1, 3))
            thing = np.where(state.labels_buffer <= WORLD, 0, state.labels_buffer)[inner, inner]
            values = state.depth_buffer[inner, inner].astype(float)
            # Nothing is drawn behind the status bar: the view is the part above, with its own middle.
            height = HEIGHT * SHRINK
            while player and not state.depth_buffer[height - 1].any():
                height -= 1
            bar = np.arange(HEIGHT) >= height // SHRINK
            thing[bar] = VIEW
            middle = (height / SHRINK - 1) / 2
            camera = np.array(state.game_variables, float)
            depth, explained = refine(values, *Plan(state.sectors).depth(camera, middle))
            agreed.append(explained[world & (values != SKY) & ~bar[:, None]].mean())
            distances, steps = things.look(state.labels, camera)
            depth = np.where(np.isfinite(distances[thing]), distances[thing], depth)
            overlay = (picture != reduced(silent.get_state())).any(2) | bar[:, None]
            data = (picture.astype("u1"), depth.astype("<f4"), world.astype("u1"), thing.astype("u1"), steps.astype("<f8"),
                    255 * overlay.astype("u1"), np.append(camera, middle).astype("<f8"))
            for file, plane in zip(files, data, strict=True):
                file.write(plane.tobytes())
            game.make_action([speed, turn])
            if silent is not game:
                silent.make_action([speed, turn])
    if np.mean(agreed) < MIN_EXPLAINED:
        sys.exit(f"the map explains the depth of {100 * np.mean(agreed):.0f} % of {name}'s surfaces alone")
    for file in files:
        file.close()
    game.close()


if __name__ == "__main__":
    main()
