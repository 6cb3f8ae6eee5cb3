"""A three-joint arm as MJCF, for cells of the tests' own."""


def bodies(first: float, second: float) -> str:
    """Two joints about z with limits of +-`first` and +-`second` rad, and one that tilts the hand.

    The site `tool` is at its tip.
    """
    return f"""
    <body name="upper">
      <joint name="a" axis="0 0 1" range="-{first} {first}" limited="true"/>
      <geom name="upper" type="capsule" fromto="0 0 0 0.4 0 0" size="0.05"/>
      <body name="fore" pos="0.4 0 0">
        <joint name="b" axis="0 0 1" range="-{second} {second}" limited="true"/>
        <geom name="fore" type="capsule" fromto="0.08 0 0 0.4 0 0" size="0.04"/>
        <body name="hand" pos="0.4 0 0">
          <joint name="c" axis="0 1 0" range="-2.8 2.8" limited="true"/>
          <geom name="hand" type="box" pos="0.1 0 0" size="0.08 0.03 0.03"/>
          <site name="tool" pos="0.2 0 0"/>
        </body>
      </body>
    </body>"""


MOTORS = """<actuator>
    <motor name="a" joint="a"/><motor name="b" joint="b"/><motor name="c" joint="c"/>
  </actuator>"""
