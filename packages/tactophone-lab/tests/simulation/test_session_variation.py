from tactophone_lab.simulation.microphone_models import COMPETITION, SessionVariation


def test_a_drawn_session_lies_about_the_nominal_one() -> None:
    nominal = SessionVariation()
    for seed in range(20):
        drawn = SessionVariation.draw(seed)
        assert (
            0.5 < drawn.electronics.contact_gain / nominal.electronics.contact_gain < 2
        )
        assert 0.7 < drawn.finger.normal_strain / nominal.finger.normal_strain < 1.4
        assert drawn.seed == seed


def test_a_hall_is_louder_than_a_laboratory() -> None:
    assert (
        SessionVariation.draw(3, COMPETITION).electronics.room_dbfs
        > SessionVariation.draw(3).electronics.room_dbfs + 5
    )
