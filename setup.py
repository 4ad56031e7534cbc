"""Installs subsoil_ros, by pip or colcon. Metadata is in setup.cfg; here are the files of a ROS 2 package."""

from pathlib import Path

from setuptools import Distribution, setup

SHARE = "share/subsoil_ros"


def files(pattern: str) -> list[str]:
    """Files of this tree that match `pattern`, relative to it."""
    return sorted(str(path) for path in Path().glob(pattern) if path.is_file())


class RosPackage(Distribution):
    """A distribution whose data files are installed with an editable install too."""

    def has_data(self) -> bool:
        """Whether there are data files: the name that setuptools' editable_wheel asks for, and lacks."""
        return self.has_data_files()


setup(
    distclass=RosPackage,
    python_requires=">=3.10",  # here, because colcon cannot read it from setup.cfg
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/subsoil_ros"]),
        (SHARE, ["package.xml"]),
        (f"{SHARE}/config", ["config/scene.schema.json", "config/summary.schema.json"]),
        (
            f"{SHARE}/msg_defs/msg",
            files("msg_defs/msg/*.msg"),
        ),  # for bags where subsoil_msgs is not installed
        (f"{SHARE}/launch", files("launch/*.launch.py")),
        (f"{SHARE}/config/scenes", files("config/scenes/*.yaml")),
        (f"{SHARE}/config/templates", files("config/templates/*.yaml")),
        (f"{SHARE}/config/meshes", files("config/meshes/*.stl")),
        (f"{SHARE}/config/soils", files("config/soils/*.yaml")),
        (f"{SHARE}/config/materials", files("config/materials/*.yaml")),
        (f"{SHARE}/config/calibration", files("config/calibration/*.yaml")),
        (f"{SHARE}/config/presets", files("config/presets/*.yaml")),
        (f"{SHARE}/config/references", files("config/references/*.yaml")),
        (f"{SHARE}/config/studies", files("config/studies/*.yaml")),
        (f"{SHARE}/config/foxglove", files("config/foxglove/*.json")),
        (f"{SHARE}/config/rviz", files("config/rviz/*.rviz")),
        # `ros2 run` looks in lib/subsoil_ros, console scripts are in bin.
        ("lib/subsoil_ros", files("scripts/*")),
    ],
)
